//! Emulated on-board computer of an AscTec vehicle: executes motor commands and set-points, and replies. Pure.
//!
//! The computer executes the newest command that it can decode. The command's checksum is a sum of words: a pair of wrong bits
//! passes if one is set and the other cleared at the same place of two words. Values out of range are also rejected; all others
//! are executed. At one wrong bit in a hundred, a quarter of the commands can be decoded, and six in a thousand of these are
//! wrong (`six_commands_in_a_thousand_are_wrong_at_one_wrong_bit_in_a_hundred`): one every eleven seconds at 60 Hz, effective
//! until the next command is decoded.

mod motors;
mod options;
mod pty;

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, Imu, LlStatus, MAX_TELEMETRY, Poll, Scales, Status,
    StickMeaning, Sticks, VehicleDecoder, acknowledgement_frame,
};
use oqtal_wire::link::AsctecLink;
use oqtal_wire::stream::DecoderCounters;
use oqtal_wire::xbee::{Carrier, MAX_PAYLOAD, RadioEvent, Side};

use super::command::{angles, turning_command};
use super::radio::RadioModel;
use super::vehicle::{EmulatedVehicle, FrameCounters, Measured, OnBoardComputer};
use crate::plant::Plant;
use motors::MotorSwitch;

pub(super) use options::check;
pub(super) use pty::PseudoTerminal;

/// Height above which the vehicle reports that it is flying \[m\].
const FLYING_M: f64 = 0.05;

/// Emulated AscTec vehicle behind its radio.
pub type AsctecVehicle = EmulatedVehicle<RadioModel, AsctecComputer>;

impl AsctecVehicle {
    /// The vehicle of `config` on the floor at `start`, at the far end of `link`.
    ///
    /// # Errors
    /// An option of `[plant.wire]` is invalid.
    pub fn new(config: &Config, link: &AsctecLink, start: Time) -> Result<Self, OptionError> {
        let radio = RadioModel::new(&config.plant.wire, config.clock.seed, link.serial.baud);
        let computer = AsctecComputer::new(config, link)?;
        Ok(Self::with_parts(Plant::new(config, start), radio, computer))
    }
}

/// On-board computer of a Hummingbird, with the XBee of its host.
#[derive(Debug)]
pub struct AsctecComputer {
    carrier: Carrier,
    decoder: VehicleDecoder,
    scales: Scales,
    /// Gain of the vehicle's attitude loop \[1/s\].
    attitude_gain: f64,
    timeout: Span,
    motors: MotorSwitch,
    sticks: Sticks,
    received_at: Option<Time>,
    /// Frame ids for which the host requested a delivery report \[-\].
    requests: Vec<u8>,
    commands: Vec<HostCommand>,
    /// Replies, without the framing of the XBee.
    replies: Vec<Vec<u8>>,
}

impl AsctecComputer {
    fn new(config: &Config, link: &AsctecLink) -> Result<Self, OptionError> {
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        let plant = &config.plant;
        // Replies are framed in the same way as the host's requests.
        let peer = options::address(config)?;
        Ok(Self {
            carrier: Carrier::new(link.xbee, Side::Radio, peer),
            decoder: VehicleDecoder::new(),
            scales: options::scales(config)?,
            attitude_gain: plant.attitude_gain_per_s,
            timeout: millis(plant.wire.time_out_ms),
            motors: MotorSwitch::new(millis(plant.wire.motor_switch_ms)),
            sticks: Sticks::default(),
            received_at: None,
            requests: Vec::with_capacity(64),
            commands: Vec::with_capacity(64),
            replies: Vec::with_capacity(64),
        })
    }

    /// Executes a message and queues the reply.
    fn execute(&mut self, now: Time, command: &HostCommand, measured: &Measured) {
        match command {
            HostCommand::Control(input) => {
                self.control(now, input);
                self.replies.push(acknowledgement_frame(Descriptor::ControlInput).to_vec());
            }
            HostCommand::Poll(poll) => self.report(now, *poll, measured),
            HostCommand::EmergencyStop => self.halt(),
        }
    }

    /// Whether the motors run.
    pub fn motors_run(&self) -> bool {
        self.motors.is_running()
    }

    fn control(&mut self, now: Time, input: &ControlInput) {
        self.received_at = Some(now);
        let takes = |axis: i16| input.enabled & axis != 0;
        let switches = self.scales.is_motor_switch(input)
            && takes(ControlInput::ENABLE_YAW)
            && takes(ControlInput::ENABLE_THRUST);
        self.motors.command(now, switches);
        // Axes that the host does not command follow the pilot's sticks, which are centred.
        let centred = |axis: i16, counts: i16| if takes(axis) { counts } else { 0 };
        self.sticks = self.scales.decode(&ControlInput {
            pitch: centred(ControlInput::ENABLE_PITCH, input.pitch),
            roll: centred(ControlInput::ENABLE_ROLL, input.roll),
            yaw: if switches { 0 } else { centred(ControlInput::ENABLE_YAW, input.yaw) },
            thrust: centred(ControlInput::ENABLE_THRUST, input.thrust),
            enabled: input.enabled,
        });
    }

    fn halt(&mut self) {
        self.motors.stop();
        self.sticks = Sticks::default();
    }

    fn report(&mut self, now: Time, poll: Poll, measured: &Measured) {
        let (mut frame, mut reply) = ([0; MAX_TELEMETRY], Vec::new());
        if poll.contains(Poll::LL_STATUS) {
            let length = self.status(now, measured).write_frame(&mut frame);
            reply.extend(&frame[..length]);
        }
        if poll.contains(Poll::IMU_CALC) {
            let length = self.scales.encode_imu(&imu(measured)).write_frame(&mut frame);
            reply.extend(&frame[..length]);
        }
        self.replies.push(reply);
    }

    fn status(&self, now: Time, measured: &Measured) -> LlStatus {
        let status = Status {
            battery_v: measured.battery_v,
            motors_on: self.motors.is_running(),
            flying: measured.truth.position[2] > FLYING_M,
        };
        let up_time = self.motors.up_time(now).seconds().min(f64::from(i16::MAX)) as i16;
        LlStatus { up_time, ..status.into() }
    }
}

impl OnBoardComputer for AsctecComputer {
    fn next_event(&self) -> Option<Time> {
        self.received_at.map(|at| at + self.timeout)
    }

    fn receive(&mut self, now: Time, bytes: &[u8], measured: &Measured) {
        for arrival in self.carrier.push(bytes) {
            if let RadioEvent::Payload { id, payload } = arrival {
                self.commands.extend(self.decoder.push(&payload));
                self.requests.push(id);
            }
        }
        let mut commands = std::mem::take(&mut self.commands);
        commands.drain(..).for_each(|command| self.execute(now, &command, measured));
        self.commands = commands;
    }

    /// Stops the motors if the command timeout has passed at `now`.
    fn tick(&mut self, now: Time, _: &Measured) {
        if self.next_event().is_some_and(|at| at <= now) {
            self.received_at = None;
            self.halt();
        }
    }

    fn reply(&mut self, send: &mut dyn FnMut(&[u8])) {
        for id in self.requests.drain(..) {
            send(self.carrier.report(id, true).as_bytes());
        }
        for reply in self.replies.drain(..) {
            for piece in reply.chunks(MAX_PAYLOAD) {
                if let Ok(frame) = self.carrier.wrap(0, piece) {
                    send(frame.as_bytes());
                }
            }
        }
    }

    fn command(&self, _: Time, truth: &TruthV1) -> CommandV1 {
        if !self.motors.is_running() {
            return CommandV1::default();
        }
        let Sticks { roll, pitch, yaw, thrust } = self.sticks;
        match self.scales.sticks {
            StickMeaning::BodyRate => CommandV1 {
                actuation: Actuation::Sticks.code(),
                sticks: [roll, pitch, yaw],
                thrust,
                ..CommandV1::default()
            },
            StickMeaning::Attitude => {
                let heading = (angles(truth.attitude).yaw, yaw);
                turning_command([roll, pitch], heading, self.attitude_gain, thrust)
            }
        }
    }

    fn counters(&self) -> FrameCounters {
        let DecoderCounters { frames, damaged, .. } = self.decoder.counters();
        FrameCounters { read: frames, damaged }
    }
}

fn imu(measured: &Measured) -> Imu {
    let truth = &measured.truth;
    Imu {
        angles: angles(truth.attitude).vector().into(),
        rate: truth.rate,
        height: truth.position[2],
        climb: truth.velocity[2],
    }
}
