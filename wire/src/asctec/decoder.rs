//! Grammars of the AscTec frames, for either end of the stream.

use super::command::{COMMAND_HEAD, POLL_HEAD, POLL_LEN, read_poll};
use super::telemetry::{ACKNOWLEDGEMENT_LEN, ENVELOPE, HEAD, PREFIX, read_acknowledgement};
use super::{
    ControlInput, Descriptor, EMERGENCY_STOP, HostCommand, ImuCalc, LlStatus, TelemetryPacket,
};
use crate::stream::{Decoder, Grammar, Verdict};

/// Message from vehicle to host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostEvent {
    /// Acknowledgement of a packet of this kind.
    Acknowledged(Descriptor),
    /// Battery and state.
    LlStatus(LlStatus),
    /// Fused inertial measurements.
    ImuCalc(ImuCalc),
    /// Telemetry whose payload is not decoded.
    Other(Descriptor),
}

/// Grammar of acknowledgements and telemetry.
#[derive(Clone, Copy, Debug)]
pub struct HostGrammar;

/// Decoder of the stream to the host.
pub type HostDecoder = Decoder<HostGrammar>;

/// Grammar of commands, polls and the emergency stop.
#[derive(Clone, Copy, Debug)]
pub struct VehicleGrammar;

/// Decoder of the stream to the vehicle.
pub type VehicleDecoder = Decoder<VehicleGrammar>;

impl Grammar for HostGrammar {
    type Event = HostEvent;

    const START: u8 = b'>';

    fn inspect(bytes: &[u8]) -> Verdict<HostEvent> {
        match bytes.get(1) {
            None => Verdict::Wait(2),
            Some(b'a') => acknowledgement(bytes),
            Some(b'*') => telemetry(bytes),
            Some(_) => Verdict::Noise,
        }
    }
}

fn acknowledgement(bytes: &[u8]) -> Verdict<HostEvent> {
    let Some(frame) = bytes.get(..ACKNOWLEDGEMENT_LEN) else {
        return Verdict::Wait(ACKNOWLEDGEMENT_LEN);
    };
    match read_acknowledgement(frame) {
        Ok(descriptor) => Verdict::Accept(frame.len(), Some(HostEvent::Acknowledged(descriptor))),
        Err(_) => Verdict::Damaged,
    }
}

fn telemetry(bytes: &[u8]) -> Verdict<HostEvent> {
    if !agrees(bytes, HEAD) {
        return Verdict::Noise;
    }
    let Some(&[_, _, _, low, high, number]) = bytes.first_chunk::<PREFIX>() else {
        return Verdict::Wait(PREFIX);
    };
    // A length that is not the descriptor's is rejected: otherwise one wrong bit could consume the frames that follow.
    let length = usize::from(u16::from_le_bytes([low, high]));
    let descriptor = Descriptor::from_wire(number);
    if descriptor.is_none_or(|descriptor| descriptor.payload_len() != length) {
        return Verdict::Damaged;
    }
    let Some(frame) = bytes.get(..length + ENVELOPE) else {
        return Verdict::Wait(length + ENVELOPE);
    };
    match TelemetryPacket::new_checked(frame) {
        Ok(packet) => Verdict::Accept(frame.len(), event(&packet)),
        Err(_) => Verdict::Damaged,
    }
}

fn event(packet: &TelemetryPacket) -> Option<HostEvent> {
    match packet.descriptor() {
        Descriptor::LlStatus => LlStatus::parse(packet.payload()).map(HostEvent::LlStatus),
        Descriptor::ImuCalc => ImuCalc::parse(packet.payload()).map(HostEvent::ImuCalc),
        other => Some(HostEvent::Other(other)),
    }
}

impl Grammar for VehicleGrammar {
    type Event = HostCommand;

    const START: u8 = b'>';

    fn inspect(bytes: &[u8]) -> Verdict<HostCommand> {
        let length = if agrees(bytes, COMMAND_HEAD) {
            ControlInput::FRAME_LEN
        } else if agrees(bytes, POLL_HEAD) {
            POLL_LEN
        } else if agrees(bytes, &EMERGENCY_STOP) {
            EMERGENCY_STOP.len()
        } else {
            return Verdict::Noise;
        };
        // The shortest frame is as long as the longest head: with that many bytes the kind of frame is known.
        if bytes.len() < EMERGENCY_STOP.len() {
            return Verdict::Wait(EMERGENCY_STOP.len());
        }
        match bytes.get(..length).map(command) {
            None => Verdict::Wait(length),
            Some(None) => Verdict::Damaged,
            Some(command) => Verdict::Accept(length, command),
        }
    }
}

fn command(frame: &[u8]) -> Option<HostCommand> {
    if frame == EMERGENCY_STOP {
        return Some(HostCommand::EmergencyStop);
    }
    if let Ok(poll) = read_poll(frame) {
        return Some(HostCommand::Poll(poll));
    }
    ControlInput::read(frame).ok().map(HostCommand::Control)
}

/// Whether `bytes` and `mark` agree over the shorter of both.
fn agrees(bytes: &[u8], mark: &[u8]) -> bool {
    bytes.iter().zip(mark).all(|(byte, wanted)| byte == wanted)
}
