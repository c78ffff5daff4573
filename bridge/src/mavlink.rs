//! Protocol of PX4 and ArduPilot over MAVLink 2: set-points, poses and requests to messages, messages to replies. Bytes and axes are
//! `oqtal-wire`'s.
//!
//! | file | subject |
//! |---|---|
//! | `vehicle.rs` | the autopilot: its address, firmware, mode and reports |
//! | `starting.rs` | the commands that start and stop the motors |
//! | `wanted.rs` | parameters that the autopilot needs |
//! | `requests.rs` | heartbeat, message rates, origin of the world, exchanges of clocks |
//!
//! | set-point | SET_ATTITUDE_TARGET |
//! |---|---|
//! | zero | body rates and thrust of zero |
//! | flight, `vehicle.interface = "rate"` | the command's sticks as body rates, and thrust |
//! | flight, `attitude` | the commanded attitude, the rate that the yaw stick stands for, and thrust |
//! | start, stop | zero set-points, among them the commands for mode and arming, or disarming, until the heartbeat shows their effect |
//!
//! The bridge controls the autopilot while it is armed in the mode for set-points, Offboard or Guided_NoGPS. Armed in any other
//! mode, it is controlled by a pilot, by another ground station, or by its own failsafe.

mod requests;
mod starting;
mod vehicle;
mod wanted;

use oqtal_bus::code::VehicleRefusal;
use oqtal_bus::lease::EncoderState;
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::ThrustCurve;
use oqtal_wire::link::{AutopilotKind, MavlinkLink};
use oqtal_wire::mavlink::{
    AttitudeTarget, CommandKind, MavlinkAddress, MavlinkContent, MavlinkDecoder, MavlinkEncoder,
    MavlinkPacket, MavlinkPose, SetpointKind, SignatureCheck, VehicleCommandLong,
};

use crate::options;
use crate::protocol::{
    FrameSizes, PeriodicFrame, VehicleFrame, VehiclePose, VehicleProtocol, VehicleReply,
};
use crate::setpoint::VehicleSetpoint;
use requests::PeriodicRequests;
use starting::StartSequence;
use vehicle::AutopilotState;

pub(crate) use requests::OWN_HEARTBEAT;
pub(crate) use wanted::earlier_name;
pub use wanted::wanted_parameters;

/// Frame lengths \[bytes\]: header and checksum around the greatest payload.
const ENVELOPE: usize = 12;
const SIGNATURE: usize = 13;
const SETPOINT: usize = 39;
const ODOMETRY: usize = 233;
const TIMESYNC: usize = 18;
/// Words behind one set-point: a pose, an exchange of clocks, an answer to one, and a request.
const WORDS: usize = 4;
/// Time between two reads of the port: the greatest delay in the time stamps of clock exchanges.
const READ_PERIOD: Span = Span::from_millis(2);

/// The protocol of MAVLink's autopilots.
#[derive(Debug)]
pub struct Mavlink {
    encoder: MavlinkEncoder,
    decoder: MavlinkDecoder,
    /// Check of the signatures of received packets; `None` without a key.
    check: Option<SignatureCheck>,
    vehicle: AutopilotState,
    starting: StartSequence,
    requests: PeriodicRequests,
    holds_attitude: bool,
    /// Body rates of full sticks \[rad/s\].
    authority: [f64; 3],
    thrust: ThrustCurve,
    pose_period: Span,
    position_sd_m: f64,
    attitude_sd_rad: f64,
    /// Instant at which the port was opened: set-points count time from it.
    opened: Time,
    /// Address and kind of the autopilot, if another process has determined them.
    continued: Option<(MavlinkAddress, AutopilotKind)>,
}

impl Mavlink {
    /// Protocol to the vehicle at `link`, where Unix time is `unix_us` \[us\].
    ///
    /// # Errors
    /// A value of `[bridge.mavlink]` cannot be used.
    pub fn new(config: &Config, link: &MavlinkLink, unix_us: u64) -> Result<Self, OptionError> {
        let options = &config.bridge.mavlink;
        let (encoder, check) = encoder_and_check(config, unix_us)?;
        let thrust = options::thrust_curve("mavlink", &options.thrust_table)?;
        Ok(Self {
            encoder,
            decoder: MavlinkDecoder::new(),
            check,
            vehicle: AutopilotState::new(link.autopilot, link.system),
            starting: StartSequence::default(),
            requests: PeriodicRequests::new(Span::period_of(config.bridge.status_rate_hz)),
            holds_attitude: config.vehicle.interface.holds_attitude(),
            authority: config.vehicle.rate_authority_rad_s,
            thrust,
            pose_period: Span::period_of(options.pose_rate_hz),
            position_sd_m: options.position_sd_mm * 1e-3,
            attitude_sd_rad: options.attitude_sd_deg.to_radians(),
            opened: Time::UNSET,
            continued: None,
        })
    }

    /// The packet of `content`; empty if it cannot be sent.
    fn frame(&mut self, content: &MavlinkContent) -> VehicleFrame {
        let wire = self.encoder.encode(content);
        wire.map_or(VehicleFrame::EMPTY, |wire| VehicleFrame::of(wire.as_bytes()))
    }

    /// Address and kind of the autopilot, by its heartbeat or from another process.
    fn autopilot(&self) -> Option<(MavlinkAddress, AutopilotKind)> {
        self.vehicle.known().or(self.continued)
    }

    /// The set-point of `command`; zero rates and no thrust without one.
    fn target(&self, now: Time, target: MavlinkAddress, command: &CommandV1) -> AttitudeTarget {
        let CommandV1 { sticks, attitude, thrust, .. } = *command;
        let mut rates = sticks;
        for (rate, authority) in rates.iter_mut().zip(self.authority) {
            *rate *= authority;
        }
        let has_attitude = attitude.iter().any(|number| *number != 0.0);
        let kind = if self.holds_attitude && has_attitude {
            let yaw_rate = rates[2];
            match self.autopilot() {
                Some((_, AutopilotKind::ArduPilot)) => {
                    SetpointKind::AttitudeAndRates { attitude, yaw_rate }
                }
                _ => SetpointKind::Attitude { attitude, yaw_rate },
            }
        } else {
            SetpointKind::Rates(rates)
        };
        let since = if self.opened.is_set() { now.since(self.opened) } else { Span::ZERO };
        // Wraps around after 49 days.
        let time_ms = (since.nanos() / 1_000_000) as u32;
        AttitudeTarget { target, time_ms, kind, thrust: self.thrust.thrust(thrust) }
    }
}

/// Encoder of the bridge's own packets and check of received ones, where Unix time is `unix_us` \[us\]. Without a configured key, packets
/// are neither signed nor checked.
///
/// # Errors
/// The key cannot be used.
pub(crate) fn encoder_and_check(
    config: &Config,
    unix_us: u64,
) -> Result<(MavlinkEncoder, Option<SignatureCheck>), OptionError> {
    let options = &config.bridge.mavlink;
    let own = MavlinkAddress { system: options.system, component: options.component };
    let mut encoder = MavlinkEncoder::new(own);
    let key = options::signing_key(config)?;
    if let Some(key) = key.clone() {
        encoder.sign(key, unix_us);
    }
    Ok((encoder, key.map(|key| SignatureCheck::new(key, unix_us))))
}

/// Whether `packet` is accepted: signed with the key of `check`, if there is one. Packets of `encoder` are stamped later than
/// it from now on.
pub(crate) fn is_accepted(
    check: &mut Option<SignatureCheck>,
    encoder: &mut MavlinkEncoder,
    packet: &MavlinkPacket,
) -> bool {
    let Some(check) = check else { return true };
    let accepted = check.accepts(packet.from, packet.signed.as_ref());
    if accepted {
        encoder.follow(check);
    }
    accepted
}

impl VehicleProtocol for Mavlink {
    fn sizes(&self) -> FrameSizes {
        let around = ENVELOPE + if self.encoder.signs() { SIGNATURE } else { 0 };
        FrameSizes {
            setpoint: SETPOINT + around,
            acknowledgement: 0,
            periodic: ODOMETRY + around,
            periodic_reply: TIMESYNC + around,
        }
    }

    fn setpoint(&mut self, now: Time, setpoint: &VehicleSetpoint) -> VehicleFrame {
        if !self.opened.is_set() {
            self.opened = now;
        }
        let known = self.vehicle.known();
        let Some((target, _)) = self.autopilot() else { return VehicleFrame::EMPTY };
        let command = match setpoint {
            VehicleSetpoint::Released => {
                self.starting.reset();
                return VehicleFrame::EMPTY;
            }
            VehicleSetpoint::StartMotors => {
                known.and_then(|known| self.starting.start(now, known, &self.vehicle))
            }
            VehicleSetpoint::StopMotors => {
                self.starting.stop(now, target, self.vehicle.heartbeat_at())
            }
            VehicleSetpoint::Zero => {
                self.starting.rest();
                None
            }
            VehicleSetpoint::Fly(_) => {
                self.starting.fly();
                None
            }
        };
        if let Some(command) = command {
            return self.frame(&MavlinkContent::Command(command));
        }
        self.starting.note_setpoint(now);
        let flight = match setpoint {
            VehicleSetpoint::Fly(command) => *command,
            _ => CommandV1::default(),
        };
        let target = self.target(now, target, &flight);
        self.frame(&MavlinkContent::AttitudeTarget(target))
    }

    fn pose_period(&self) -> Option<Span> {
        Some(self.pose_period)
    }

    fn pose(&mut self, _: Time, pose: &VehiclePose) -> VehicleFrame {
        let Some((_, kind)) = self.vehicle.known() else { return VehicleFrame::EMPTY };
        let pose = MavlinkPose {
            time_us: pose.captured_at.nanos() / 1000,
            position: pose.position,
            attitude: pose.attitude.xyzw(),
            position_sd_m: self.position_sd_m,
            attitude_sd_rad: self.attitude_sd_rad,
        };
        // ArduPilot takes positions alone from one, and requires velocities with the other.
        self.frame(&match kind {
            AutopilotKind::Px4 => MavlinkContent::Odometry(pose),
            AutopilotKind::ArduPilot => MavlinkContent::VisionPosition(pose),
        })
    }

    fn periodic_count(&self) -> usize {
        WORDS
    }

    fn read_period(&self) -> Option<Span> {
        Some(READ_PERIOD)
    }

    fn periodic(&mut self, now: Time, _: bool) -> Option<PeriodicFrame> {
        let (content, is_answered) = self.requests.next(now, &self.vehicle)?;
        let frame = self.frame(&content);
        (!frame.bytes().is_empty()).then_some(PeriodicFrame { frame, is_answered })
    }

    fn time_out(&self) -> Option<Span> {
        self.requests.time_out()
    }

    fn is_set_up(&self) -> bool {
        self.requests.are_answered()
    }

    fn emergency_stop(&mut self) -> VehicleFrame {
        match self.vehicle.known() {
            Some((target, _)) => {
                let kind = CommandKind::Arm { run: false, is_forced: true };
                let stop = VehicleCommandLong { target, kind, confirmation: 0 };
                self.frame(&MavlinkContent::Command(stop))
            }
            None => VehicleFrame::EMPTY,
        }
    }

    fn decode(&mut self, now: Time, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        let Self { encoder, decoder, check, vehicle, starting, requests, .. } = self;
        for packet in decoder.push(bytes) {
            if !is_accepted(check, encoder, &packet) {
                vehicle.receive_unsigned(&packet, reply);
                continue;
            }
            if !vehicle.takes(now, &packet, reply) {
                continue;
            }
            match packet.content {
                MavlinkContent::Timesync(sync) => requests.receive(now, sync, reply),
                MavlinkContent::Acknowledged { command, result, target } => {
                    if encoder.own().is_meant_by(target) {
                        requests.acknowledged(command);
                        starting.acknowledged(now, command, result, reply);
                    }
                }
                MavlinkContent::Parameter { name, value } => {
                    requests.receive_parameter(vehicle, &name, &value);
                    reply(VehicleReply::Other);
                }
                content => vehicle.receive(now, &content, reply),
            }
        }
        if starting.is_unanswered() {
            reply(VehicleReply::Refused(VehicleRefusal::NoAnswer));
        }
        if vehicle.was_restarted() {
            requests.restart();
            starting.reset();
        }
    }

    /// Address of the autopilot; instant at which the port was opened; number and stamp of the next packet.
    fn encoder_state(&self) -> Option<EncoderState> {
        let (MavlinkAddress { system, component }, kind) = self.autopilot()?;
        let is_ardupilot = u8::from(kind == AutopilotKind::ArduPilot);
        let (number, stamp) = self.encoder.position();
        let [opened, stamp] =
            [self.opened.nanos(), stamp].map(|long| [long as u32, (long >> 32) as u32]);
        let address = u32::from_le_bytes([system, component, is_ardupilot, 0]);
        let number = number.into();
        Some([address, number, opened[0], opened[1], stamp[0], stamp[1], 0, 0])
    }

    fn continue_encoder(&mut self, state: &EncoderState) {
        let long = |at: usize| u64::from(state[at]) | u64::from(state[at + 1]) << 32;
        let [system, component, is_ardupilot, _] = state[0].to_le_bytes();
        let kind = if is_ardupilot == 1 { AutopilotKind::ArduPilot } else { AutopilotKind::Px4 };
        self.continued = Some((MavlinkAddress { system, component }, kind));
        self.opened = Time::from_nanos(long(2));
        self.encoder.continue_at((state[1] as u8, long(4)));
    }

    fn damaged(&self) -> u64 {
        self.decoder.counters().damaged
    }

    fn reset(&mut self) {
        self.decoder.reset();
        self.vehicle.reset();
        self.starting.reset();
        self.requests.restart();
        (self.opened, self.continued) = (Time::UNSET, None);
    }
}

#[cfg(test)]
mod tests {
    use oqtal_wire::link::LinkSpec;
    use oqtal_wire::mavlink::{AckResult, AutopilotFirmware, MavlinkHeartbeat};

    use super::*;

    #[test]
    fn acknowledgements_for_another_ground_station_are_ignored() {
        let spec: LinkSpec = "mavlink:udpin:127.0.0.1:14550".parse().unwrap();
        let LinkSpec::Mavlink(link) = &spec else { panic!("{spec}") };
        let mut mavlink = Mavlink::new(&Config::default(), link, 0).unwrap();
        let vehicle = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };
        let (mut encoder, now) = (MavlinkEncoder::new(vehicle), Time::VIRTUAL_START);
        let own = mavlink.encoder.own();
        let mut refusals = |content| {
            let (wire, mut refusals) = (encoder.encode(&content).unwrap(), 0);
            mavlink.decode(now, wire.as_bytes(), &mut |reply| {
                refusals += u32::from(matches!(reply, VehicleReply::Refused(_)));
            });
            (refusals, mavlink.starting.stop(now, vehicle, None))
        };
        let autopilot = AutopilotFirmware::Known(AutopilotKind::ArduPilot);
        let heartbeat =
            MavlinkHeartbeat { autopilot, custom_mode: 20, is_armed: true, is_simulated: false };
        assert!(refusals(MavlinkContent::Heartbeat(heartbeat)).1.is_some(), "disarming is sent");
        let denied = |target| MavlinkContent::Acknowledged {
            command: CommandKind::ARM,
            result: AckResult::Denied,
            target,
        };
        let other = MavlinkAddress { system: 255, component: 190 };
        assert_eq!(refusals(denied(other)), (0, None));
        assert_eq!(refusals(denied(own)).0, 1);
        assert_eq!(refusals(denied(MavlinkAddress::ALL)).0, 1);
    }
}
