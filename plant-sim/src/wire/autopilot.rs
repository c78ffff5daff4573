//! Emulated autopilot, PX4 or ArduCopter: modes, arming and its refusals, set-points and their time-out, telemetry, parameters.
//! Its behaviour, as far as a bridge can observe it, matches measurements of the firmware. Both time-outs are at first
//! `plant.wire.time-out-ms`. Pure.
//!
//! | | ArduCopter | PX4 |
//! |---|---|---|
//! | set-points are followed in | Guided_NoGPS | Offboard, entered only while set-points arrive |
//! | without a set-point for | `GUID_TIMEOUT`: level, height held, mode unchanged | `COM_OF_LOSS_T`: Position, level and sinking |
//! | position is known | 1.5 s after poses and the origin of the world | 1.5 s after poses by ODOMETRY |
//! | no thrust after arming for | 2 s | 1 s |
//! | heartbeats | at the requested rate | once a second, and on request |
//! | disarming in the air | refused unless forced | refused unless forced |

mod motion;
mod parameters;
mod streams;

use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::link::{AutopilotKind, MavlinkLink};
use oqtal_wire::mavlink::{
    AckResult, ArduPilotMode, AutopilotFirmware, CommandKind, MavlinkAddress, MavlinkAttitude,
    MavlinkContent, MavlinkDecoder, MavlinkEncoder, MavlinkHeartbeat, MavlinkPosition, MavlinkText,
    Px4Mode, TextSeverity, Timesync,
};

use super::datagrams::DatagramModel;
use super::vehicle::{EmulatedVehicle, FrameCounters, Measured, OnBoardComputer};
use crate::plant::Plant;
use motion::SetpointFollower;
use parameters::ParameterTable;
use streams::{Stream, TelemetryStreams};

/// Time from the first pose until the position is known.
const ALIGNMENT: Span = Span::from_millis(1500);
/// Time without a pose after which the position is unknown.
const POSES_LOST: Span = Span::from_millis(1000);
/// Greatest age of the newest set-point at which the stream of set-points counts as running.
const FLOWING: Span = Span::from_millis(500);

/// Default system id of an emulated vehicle.
const DEFAULT_SYSTEM: u8 = 1;

/// Emulated vehicle controlled over MAVLink.
pub type MavlinkVehicle = EmulatedVehicle<DatagramModel, EmulatedAutopilot>;

impl MavlinkVehicle {
    /// The vehicle of `config` on the floor at `start`, at the far end of `link`.
    ///
    /// # Errors
    /// An option of `[plant.wire.mavlink]` is invalid.
    pub fn new(config: &Config, link: &MavlinkLink, start: Time) -> Result<Self, OptionError> {
        let network = DatagramModel::new(&config.plant.wire, config.clock.seed);
        let autopilot = EmulatedAutopilot::new(config, link, start)?;
        Ok(Self::with_parts(Plant::new(config, start), network, autopilot))
    }

    /// The emulated autopilot.
    pub fn autopilot(&mut self) -> &mut EmulatedAutopilot {
        &mut self.board
    }
}

/// Emulated autopilot.
#[derive(Debug)]
pub struct EmulatedAutopilot {
    kind: AutopilotKind,
    own: MavlinkAddress,
    decoder: MavlinkDecoder,
    encoder: MavlinkEncoder,
    /// Received messages to be executed.
    received: Vec<MavlinkContent>,
    /// Messages to be sent.
    replies: Vec<MavlinkContent>,
    started: Time,
    refuses_arming: Span,
    custom_mode: u32,
    is_armed: bool,
    armed_at: Time,
    follower: SetpointFollower,
    streams: TelemetryStreams,
    parameters: ParameterTable,
    poses_since: Option<Time>,
    posed_at: Option<Time>,
    has_origin: bool,
}

impl EmulatedAutopilot {
    fn new(config: &Config, link: &MavlinkLink, started: Time) -> Result<Self, OptionError> {
        let kind = link.autopilot.unwrap_or(AutopilotKind::ArduPilot);
        let system = link.system.unwrap_or(DEFAULT_SYSTEM);
        let own = MavlinkAddress { system, component: MavlinkAddress::AUTOPILOT };
        let refuses_arming = config.plant.wire.mavlink.refuses_arming_ms;
        Ok(Self {
            kind,
            own,
            decoder: MavlinkDecoder::new(),
            encoder: MavlinkEncoder::new(own),
            received: Vec::with_capacity(16),
            replies: Vec::with_capacity(16),
            started,
            refuses_arming: Span::from_seconds(refuses_arming * 1e-3),
            custom_mode: Self::first_mode(kind),
            is_armed: false,
            armed_at: Time::UNSET,
            follower: SetpointFollower::new(config, kind)?,
            streams: TelemetryStreams::new(started),
            parameters: ParameterTable::new(kind, config.plant.wire.time_out_ms * 1e-3),
            poses_since: None,
            posed_at: None,
            has_origin: false,
        })
    }

    fn first_mode(kind: AutopilotKind) -> u32 {
        match kind {
            AutopilotKind::ArduPilot => ArduPilotMode::STABILIZE.0,
            AutopilotKind::Px4 => Px4Mode::POSITION.0,
        }
    }

    /// Whether the motors run.
    pub fn motors_run(&self) -> bool {
        self.is_armed
    }

    /// Executes a message that arrived at `now`, and queues the replies.
    fn execute(&mut self, now: Time, content: &MavlinkContent) {
        match content {
            MavlinkContent::AttitudeTarget(target) if self.own.is_meant_by(target.target) => {
                self.follower.take(now, target);
            }
            MavlinkContent::Timesync(sync) if sync.answered == 0 => {
                let answered = self.clock(now).nanos();
                self.replies.push(MavlinkContent::Timesync(Timesync { answered, ..*sync }));
            }
            MavlinkContent::Odometry(_) => self.pose(now),
            MavlinkContent::VisionPosition(_) if self.kind == AutopilotKind::ArduPilot => {
                self.pose(now);
            }
            MavlinkContent::GlobalOrigin { system } if *system == self.own.system => {
                self.has_origin = true;
            }
            MavlinkContent::Command(command) if self.own.is_meant_by(command.target) => {
                let result = self.execute_command(now, &command.kind);
                let command = command.kind.number();
                let target = MavlinkAddress::ALL;
                self.replies.push(MavlinkContent::Acknowledged { command, result, target });
            }
            MavlinkContent::ParameterRequest { target, name } if self.own.is_meant_by(*target) => {
                self.replies.extend(self.parameters.get(name));
            }
            MavlinkContent::ParameterSet { target, name, value }
                if self.own.is_meant_by(*target) =>
            {
                self.replies.extend(self.parameters.set(name, *value));
            }
            _ => {}
        }
    }

    /// Changes the mode, as a pilot does by R/C.
    pub fn pilot_takes_over(&mut self) {
        self.custom_mode = Self::first_mode(self.kind);
    }

    /// Sets the time without a set-point after which the autopilot takes over, as another ground station does \[s\].
    pub fn set_time_out(&mut self, seconds: f32) {
        self.parameters.set_time_out(seconds);
    }

    /// Time from arming to the first thrust.
    fn spool_up(&self) -> Span {
        match self.kind {
            AutopilotKind::ArduPilot => Span::from_millis(2000),
            AutopilotKind::Px4 => Span::from_millis(1000),
        }
    }

    fn follows(&self) -> bool {
        self.kind.follows_setpoints(self.custom_mode)
    }

    fn clock(&self, now: Time) -> Span {
        now.since(self.started)
    }

    fn pose(&mut self, now: Time) {
        if !self.sees_poses(now) {
            self.poses_since = Some(now);
        }
        self.posed_at = Some(now);
    }

    fn sees_poses(&self, now: Time) -> bool {
        self.posed_at.is_some_and(|at| now.since(at) <= POSES_LOST)
    }

    fn has_position(&self, now: Time) -> bool {
        let aligned = self.poses_since.is_some_and(|since| now.since(since) >= ALIGNMENT);
        self.sees_poses(now) && aligned && (self.has_origin || self.kind == AutopilotKind::Px4)
    }

    /// Executes a command and returns its acknowledgement.
    fn execute_command(&mut self, now: Time, kind: &CommandKind) -> AckResult {
        match *kind {
            CommandKind::SetMode { mode, .. } => self.set_mode(now, mode),
            CommandKind::Arm { run: true, .. } => self.arm(now),
            CommandKind::Arm { run: false, is_forced } => {
                if self.is_armed && !is_forced && !self.follower.has_landed(now) {
                    return AckResult::Failed;
                }
                self.is_armed = false;
                AckResult::Accepted
            }
            // PX4 ignores requests to change the rate of its heartbeat.
            CommandKind::MessageInterval { message: 0, .. } if self.kind == AutopilotKind::Px4 => {
                AckResult::Failed
            }
            CommandKind::MessageInterval { message, interval_us } => {
                let is_known = self.streams.set(now, message, interval_us);
                if is_known { AckResult::Accepted } else { AckResult::Denied }
            }
            CommandKind::RequestMessage { message } => {
                let is_known = self.streams.request(message);
                if is_known { AckResult::Accepted } else { AckResult::Denied }
            }
            CommandKind::Reboot => AckResult::Unsupported,
        }
    }

    fn set_mode(&mut self, now: Time, mode: u32) -> AckResult {
        self.custom_mode = match self.kind {
            AutopilotKind::ArduPilot => mode,
            AutopilotKind::Px4 => {
                let mode = Px4Mode::main(mode as u8);
                if mode == Px4Mode::OFFBOARD && !self.follower.flows(now, FLOWING) {
                    return AckResult::TemporarilyRejected;
                }
                mode.0
            }
        };
        AckResult::Accepted
    }

    fn arm(&mut self, now: Time) -> AckResult {
        if self.clock(now) < self.refuses_arming {
            self.replies.push(text(TextSeverity::Trouble, "Arm: Gyros inconsistent"));
            return AckResult::Failed;
        }
        if !self.is_armed {
            self.follower.begin(now);
            self.armed_at = now;
        }
        self.is_armed = true;
        AckResult::Accepted
    }

    fn telemetry(&self, now: Time, stream: Stream, measured: &Measured) -> MavlinkContent {
        let time_ms = (self.clock(now).nanos() / 1_000_000) as u32;
        let TruthV1 { position, velocity, attitude, .. } = measured.truth;
        let rate = measured.rate;
        match stream {
            Stream::Heartbeat => MavlinkContent::Heartbeat(MavlinkHeartbeat {
                autopilot: AutopilotFirmware::Known(self.kind),
                custom_mode: self.custom_mode,
                is_armed: self.is_armed,
                is_simulated: false,
            }),
            Stream::Battery => MavlinkContent::Battery(measured.battery_v),
            Stream::Attitude => {
                MavlinkContent::Attitude(MavlinkAttitude { time_ms, attitude, rate })
            }
            Stream::Position => {
                MavlinkContent::Position(MavlinkPosition { time_ms, position, velocity })
            }
            // Without a position an estimator still has attitude and height.
            Stream::Estimator if self.has_position(now) => {
                MavlinkContent::Estimator(MavlinkContent::ESTIMATOR_READY)
            }
            Stream::Estimator => MavlinkContent::Estimator(1 | 32),
        }
    }
}

impl OnBoardComputer for EmulatedAutopilot {
    /// Instant at which telemetry is due. Time-outs are checked at every message and every sample of the plant.
    fn next_event(&self) -> Option<Time> {
        self.streams.next_event()
    }

    fn receive(&mut self, now: Time, bytes: &[u8], _: &Measured) {
        let mut received = std::mem::take(&mut self.received);
        received.extend(self.decoder.push(bytes).map(|packet| packet.content));
        received.drain(..).for_each(|content| self.execute(now, &content));
        self.received = received;
    }

    fn tick(&mut self, now: Time, measured: &Measured) {
        self.follower.watch_height(now, measured.truth.position[2]);
        let leaves = self.kind == AutopilotKind::Px4
            && self.follows()
            && !self.follower.flows(now, self.parameters.time_out());
        if leaves {
            self.custom_mode = Px4Mode::POSITION.0;
            if self.is_armed {
                let words = "Failsafe: offboard signal lost";
                self.replies.push(text(TextSeverity::Trouble, words));
            }
        }
        for stream in self.streams.due(now) {
            let message = self.telemetry(now, stream, measured);
            self.replies.push(message);
        }
    }

    fn reply(&mut self, send: &mut dyn FnMut(&[u8])) {
        for content in self.replies.drain(..) {
            if let Some(packet) = self.encoder.encode(&content) {
                send(packet.as_bytes());
            }
        }
    }

    fn command(&self, now: Time, truth: &TruthV1) -> CommandV1 {
        if !self.is_armed || now.since(self.armed_at) < self.spool_up() {
            return CommandV1::default();
        }
        let follows = self.follows() && self.follower.flows(now, self.parameters.time_out());
        self.follower.command(now, truth, follows)
    }

    fn counters(&self) -> FrameCounters {
        let decoded = self.decoder.counters();
        FrameCounters { read: decoded.frames, damaged: decoded.damaged }
    }
}

fn text(severity: TextSeverity, words: &str) -> MavlinkContent {
    let mut text = [0; 50];
    for (place, byte) in text.iter_mut().zip(words.bytes()) {
        *place = byte;
    }
    MavlinkContent::Text(MavlinkText { severity, text, piece: 0 })
}
