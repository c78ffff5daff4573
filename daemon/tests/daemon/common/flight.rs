//! A vehicle in flight under the commands of a controller on the bench.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use oqtal_bus::code::{Actuation, Cause, OperatorCommand, SafetyState};
use oqtal_bus::message::{CommandV1, PoseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_control::predictive::{Bias, ModelInput, Motion, VehicleModel};
use oqtal_control::quaternion::Attitude;
use oqtal_daemon::{CommandModel, Tick};

use super::{Bench, FRAME};

/// A setting of a test.
pub fn set(text: &str) -> Setting {
    Setting::parse("test", text).unwrap()
}

/// A controller and the vehicle that it flies.
pub struct Flight {
    pub bench: Bench,
    pub motion: Motion,
    /// Acceleration by wind \[m/s^2, world\].
    pub wind: Vector3<f64>,
    /// Rate that is added to every command \[rad/s, body\].
    pub tumble: Vector3<f64>,
    /// Thrust over the commanded one \[-\].
    pub lift: f64,
    /// Height of the floor \[m\].
    pub floor: f64,
    /// Standard deviation, about, of the poses \[m\].
    pub noise: f64,
    pub last_command: CommandV1,
    model: VehicleModel,
    max_thrust: f64,
    on_air: VecDeque<(Time, CommandV1)>,
    acting: CommandV1,
    time: Time,
}

impl Flight {
    /// A vehicle on the floor whose flight was requested.
    pub fn new(settings: &[Setting]) -> Self {
        let config = Config::from_settings(settings).unwrap();
        let mut bench = Bench::new(settings);
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        Self {
            motion: Motion::default(),
            wind: Vector3::zeros(),
            tumble: Vector3::zeros(),
            lift: 1.0,
            floor: 0.0,
            noise: 1e-4,
            last_command: CommandV1::default(),
            model: CommandModel::new(&config).unwrap().model,
            max_thrust: config.vehicle.max_thrust_n,
            on_air: VecDeque::new(),
            acting: CommandV1::default(),
            time: bench.now,
            bench,
        }
    }

    /// A vehicle that hovers at one metre.
    pub fn hovering(settings: &[Setting]) -> Self {
        let mut flight = Self::new(
            &[settings, &[set("trajectory.settle-s=60"), set("trajectory.kind=\"hover\"")]]
                .concat(),
        );
        flight.run(300);
        assert_eq!(flight.state(), SafetyState::Nominal, "{}", flight.cause());
        assert!((flight.motion.position.z - 1.0).abs() < 0.1, "{:?}", flight.motion);
        flight
    }

    /// A vehicle whose thrust is `lift` times the commanded one, and which therefore hovers somewhere above its reference.
    pub fn hovering_anywhere(settings: &[Setting], lift: f64) -> Self {
        let mut flight = Self::new(&[settings, &[set("trajectory.settle-s=60")]].concat());
        flight.lift = lift;
        flight.run(400);
        assert_eq!(flight.state(), SafetyState::Nominal, "{}", flight.cause());
        flight
    }

    /// Flies for some frames with good poses.
    pub fn run(&mut self, frames: usize) {
        for _ in 0..frames {
            self.frame(Some);
        }
    }

    /// Flies for a frame; the cameras deliver what `change` makes of the pose, nothing for `None`.
    pub fn frame(&mut self, change: impl FnOnce(PoseV1) -> Option<PoseV1>) -> Option<Tick> {
        let arrival = self.bench.now + FRAME;
        self.advance(arrival - self.bench.latency);
        let tick = match change(self.pose()) {
            Some(pose) => {
                let tick = self.bench.show(pose);
                self.advance(self.bench.now);
                tick
            }
            None => {
                let tick = self.bench.miss();
                self.advance(self.bench.now);
                tick
            }
        };
        if let Some(tick) = tick {
            self.last_command = tick.command;
            self.on_air.push_back((self.bench.now + self.bench.radio, tick.command));
        }
        tick
    }

    /// Frames until `state`, each delivering what `change` makes of its pose; time until then.
    pub fn until(
        &mut self,
        state: SafetyState,
        mut change: impl FnMut(PoseV1) -> Option<PoseV1>,
    ) -> Span {
        let since = self.bench.now;
        while self.state() != state {
            assert!(self.bench.now.since(since) < Span::from_millis(60_000), "never {state}");
            self.frame(&mut change);
        }
        self.bench.now.since(since)
    }

    pub fn state(&self) -> SafetyState {
        self.bench.state().unwrap()
    }

    pub fn cause(&self) -> Cause {
        Cause::from_code(self.bench.cycle.telemetry().cause).unwrap()
    }

    /// Tilt of the vehicle \[deg\].
    pub fn tilt_deg(&self) -> f64 {
        self.motion.attitude.to_world(&Vector3::z()).z.clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Whether the vehicle acts on a command with motors on.
    pub fn is_powered(&self) -> bool {
        self.acting.actuation != Actuation::Disarmed.code()
    }

    fn pose(&self) -> PoseV1 {
        let frame = self.bench.frame as f64;
        let noise = Vector3::new((frame * 1.3).sin(), (frame * 2.1).sin(), (frame * 3.7).sin());
        PoseV1 {
            position: (self.motion.position + noise * self.noise).into(),
            attitude: self.motion.attitude.turned_by(noise * self.noise).xyzw(),
            tracked: 1,
            ..PoseV1::default()
        }
    }

    fn advance(&mut self, until: Time) {
        while self.time < until {
            let next = (self.time + Span::from_millis(1)).min(until);
            while self.on_air.front().is_some_and(|(at, _)| *at <= self.time) {
                self.acting = self.on_air.pop_front().unwrap().1;
            }
            let input = ModelInput {
                demand: Vector3::from(self.acting.sticks) * 2.0 + self.tumble,
                // Followed by a vehicle that holds attitudes; motors that are off follow nothing.
                attitude: Attitude::from_xyzw(self.acting.attitude).unwrap_or(Attitude::LEVEL),
                thrust_n: self.acting.thrust * self.max_thrust * self.lift,
            };
            let bias = Bias { acceleration: self.wind, ..Bias::default() };
            let dt = next.since(self.time).seconds();
            let before = self.motion;
            self.motion = self.model.advance(&before, &input, &bias, dt);
            if self.motion.position.z <= self.floor && self.motion.velocity.z <= 0.0 {
                let thrust_n = self.motion.thrust_n;
                self.motion = Motion {
                    velocity: Vector3::zeros(),
                    rate: Vector3::zeros(),
                    thrust_n,
                    ..before
                };
                self.motion.position.z = self.floor;
            }
            self.time = next;
        }
    }
}

/// The pose of a body with swapped markers: turned by `degrees` about its z axis.
pub fn relabelled(pose: PoseV1, degrees: f64) -> PoseV1 {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), degrees.to_radians());
    let attitude = Attitude::from_xyzw(pose.attitude).unwrap();
    let turned = Attitude::from_unit_quaternion(attitude.unit_quaternion() * turn);
    PoseV1 { attitude: turned.xyzw(), ..pose }
}

/// The pose, moved by `offset` \[m, world\].
pub fn moved(pose: PoseV1, offset: Vector3<f64>) -> PoseV1 {
    PoseV1 { position: (Vector3::from(pose.position) + offset).into(), ..pose }
}
