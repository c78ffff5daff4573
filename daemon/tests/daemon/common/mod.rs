//! A controller on the bench: its cameras, its vehicle and their clock.
#![allow(dead_code)]

pub mod flight;

use oqtal_bus::code::{Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{Header, PoseV1, Stamps, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_daemon::{Cycle, Tick, trajectory};

pub const FRAME: Span = Span::from_nanos(16_666_667);
pub const LATENCY: Span = Span::from_millis(15);
const RADIO: Span = Span::from_millis(20);

pub const LAWS: [&str; ControllerName::NAMES.len()] = ControllerName::NAMES;

/// A controller and the clock of its cameras.
pub struct Bench {
    pub cycle: Cycle,
    pub frame: u64,
    pub sent: u64,
    pub now: Time,
    /// State that the vehicle reports once a command acts, unless it is silent.
    pub vehicle: VehicleV1,
    pub silent: bool,
    /// Capture to pose.
    pub latency: Span,
    /// Arrival of a pose to the command about it.
    pub compute: Span,
    /// Command to its effect.
    pub radio: Span,
    /// The process that publishes the state of the vehicle.
    pub source: u64,
}

/// A simulated vehicle that answers: its motors need no start.
pub const WELL: VehicleV1 = VehicleV1 {
    command_sequence: 0,
    lost: 0,
    battery_v: 11.1,
    link_quality: 1.0,
    wire_ns: 0,
    air_ns: 0,
    estimate_position: [f64::NAN; 3],
    estimate_attitude: [0.0; 4],
    body_rate: [0.0; 3],
    body_rate_at: Time::UNSET,
    answered_at: Time::UNSET,
    time_out_s: 0.5,
    armed: 0,
    starting: 0,
    stopped: 0,
    link: 1,
    simulated: 1,
    control: 0,
    refusal: 0,
    estimator: 0,
    text: oqtal_bus::text::ShortText::EMPTY,
};

/// A vehicle that really flies and answers; its motors stand.
pub const REAL: VehicleV1 = VehicleV1 { simulated: 0, ..WELL };

impl Bench {
    pub fn new(settings: &[Setting]) -> Self {
        let config = Config::from_settings(settings).unwrap();
        let trajectory = trajectory(&config).unwrap();
        let now = Time::VIRTUAL_START;
        let cycle = Cycle::new(&config, trajectory, now).unwrap();
        Self {
            cycle,
            frame: 0,
            sent: 0,
            now,
            vehicle: WELL,
            silent: false,
            latency: LATENCY,
            compute: Span::default(),
            radio: RADIO,
            source: 1,
        }
    }

    /// A controller that was commanded to fly and has accepted its first poses.
    pub fn flying(settings: &[Setting]) -> Self {
        let mut bench = Self::new(settings);
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        for _ in 0..10 {
            bench.show(still(bench.frame));
        }
        assert_eq!(bench.mode(), Some(Mode::Flying));
        bench
    }

    /// The next frame arrives.
    pub fn show(&mut self, pose: PoseV1) -> Option<Tick> {
        self.frame += 1;
        self.now = self.now + FRAME;
        let stamps = Stamps {
            captured_at: self.now - self.latency,
            pose_published_at: self.now,
            ..Stamps::default()
        };
        let header = Header { pose_sequence: self.frame, stamps, ..Header::default() };
        let tick = self.cycle.step(self.now, Some(&(header, pose)));
        self.send(tick)
    }

    /// A command goes out at once and acts after the radio's delay.
    pub fn send(&mut self, tick: Option<Tick>) -> Option<Tick> {
        let sent = tick?;
        self.sent += 1;
        let stamps = Stamps { command_published_at: self.now + self.compute, ..sent.stamps };
        self.cycle.report(&stamps, self.sent);
        let stamps = Stamps { applied_at: self.now + self.radio, ..stamps };
        let vehicle = VehicleV1 { command_sequence: self.sent, ..self.vehicle };
        if !self.silent {
            let header = Header { source: self.source, stamps, ..Header::default() };
            self.cycle.receive_vehicle(self.now, &header, &vehicle);
        }
        tick
    }

    /// No frame arrives until the deadline.
    pub fn miss(&mut self) -> Option<Tick> {
        self.frame += 1;
        self.now = self.cycle.next_event();
        let tick = self.cycle.step(self.now, None);
        self.send(tick)
    }

    pub fn mode(&self) -> Option<Mode> {
        Mode::from_code(self.cycle.telemetry().mode)
    }

    pub fn state(&self) -> Option<SafetyState> {
        SafetyState::from_code(self.cycle.telemetry().state)
    }
}

/// A vehicle at rest on the floor, with the noise that every real pose has.
pub fn still(frame: u64) -> PoseV1 {
    let noise = 1e-5 * (frame % 11) as f64;
    PoseV1 {
        position: [noise, 0.0, 0.0],
        attitude: [noise, 0.0, 0.0, 1.0],
        tracked: 1,
        ..PoseV1::default()
    }
}
