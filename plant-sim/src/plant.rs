//! The vehicle in its room, from event to event: camera instants, milliseconds, commands off the radio.

use std::collections::VecDeque;

use nalgebra::Vector3;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps, TruthV1, VehicleV1};
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_config::{Config, VehicleKind};

use crate::dynamics::{Disturbance, Dynamics, Input};
use crate::state::State;
use crate::world::{Cell, Gust, imperfections, rest_on_floor};

/// Rate of the integration grid \[Hz\]: no step is longer than its period, and gusts change with it.
const INTEGRATION_HZ: f64 = 1000.0;

/// A vehicle that hears nothing for so long stops its motors by itself.
const COMMAND_TIME_OUT: Span = Span::from_millis(250);

/// What the plant says while time passes.
#[derive(Clone, Copy, Debug)]
pub enum Output {
    /// A sample of the truth.
    Truth(TruthV1),
    /// A command began to act: its pose, its stamps, the vehicle's answer.
    Applied(u64, Stamps, VehicleV1),
}

/// A command on the radio.
#[derive(Clone, Copy, Debug)]
struct OnAir {
    acts_at: Time,
    header: Header,
    command: CommandV1,
}

/// A simulated vehicle and its radio. Pure: time comes in as an argument.
#[derive(Clone, Debug)]
pub struct Plant {
    dynamics: Dynamics,
    state: State,
    time: Time,
    millisecond: Grid,
    camera: Grid,
    gust: Gust,
    battery: Cell,
    drift: Vector3<f64>,
    constant_acceleration: Vector3<f64>,
    radio: VecDeque<OnAir>,
    radio_delay: Span,
    input: Input,
    understands: Actuation,
    max_torque: f64,
    /// When the motors stop if nothing more is heard; never while they stand.
    falls_silent_at: Option<Time>,
    armed: bool,
    commands_lost: u64,
}

impl Plant {
    /// The vehicle of `config` on the floor at `start`.
    #[must_use]
    pub fn new(config: &Config, start: Time) -> Self {
        let (vehicle, seed) = (&config.vehicle, config.clock.seed);
        let (drift, constant_acceleration) = imperfections(vehicle, seed);
        Self {
            dynamics: Dynamics::new(vehicle),
            state: State::on_floor(),
            time: start,
            millisecond: Grid::new(start, INTEGRATION_HZ),
            camera: Grid::new(start, config.mocap.rate_hz),
            gust: Gust::new(vehicle, seed, 1.0 / INTEGRATION_HZ),
            battery: Cell::new(vehicle),
            drift,
            constant_acceleration,
            radio: VecDeque::with_capacity(64),
            radio_delay: Span::from_seconds(vehicle.radio_delay_ms * 1e-3),
            input: Input::default(),
            understands: match vehicle.kind {
                VehicleKind::Hummingbird => Actuation::Sticks,
                VehicleKind::Spacecraft => Actuation::Torque,
            },
            max_torque: vehicle.max_torque_nm,
            falls_silent_at: None,
            armed: false,
            commands_lost: 0,
        }
    }

    /// The next instant at which something happens that others depend on: a camera frame, or a command that begins to act.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let applied = self.radio.front().map(|on_air| on_air.acts_at);
        [applied, self.falls_silent_at].into_iter().flatten().fold(self.camera.next(), Time::min)
    }

    /// The next instant at which observers expect a sample.
    #[must_use]
    pub fn next_sample(&self) -> Time {
        self.millisecond.next().min(self.next_event())
    }

    /// Takes a command off the bus at `now`; it acts after the radio's delay. `lost` commands never arrived, in total.
    pub fn receive(&mut self, now: Time, header: Header, command: CommandV1, lost: u64) {
        let mut header = header;
        header.stamps.received_at = now;
        self.commands_lost = lost;
        self.radio.push_back(OnAir { acts_at: now + self.radio_delay, header, command });
    }

    /// Lets `command` act at the instant reached, for a vehicle that has its commands from elsewhere: of these it says nothing.
    pub fn steer(&mut self, command: &CommandV1) {
        self.act_on(command);
    }

    /// Battery voltage under load \[V\].
    #[must_use]
    pub fn battery_v(&self) -> f64 {
        self.battery.voltage()
    }

    /// Flies on to `until`, exactly from event to event in steps of at most a millisecond, and tells `out` what happens.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(Output)) {
        loop {
            self.apply_due(&mut out);
            let sampled = self.pass_grids();
            if let Some(truth) = sampled {
                out(Output::Truth(truth));
            }
            if self.time >= until {
                return;
            }
            let next = self.next_sample().min(until);
            self.integrate(next.since(self.time).seconds());
            self.time = next;
        }
    }

    /// The truth at the instant reached.
    #[must_use]
    pub fn truth(&self) -> TruthV1 {
        let q = self.state.attitude;
        TruthV1 {
            time: self.time,
            capture: 0,
            position: self.state.position.into(),
            velocity: self.state.velocity.into(),
            attitude: [q.i, q.j, q.k, q.w],
            rate: self.state.rate.into(),
        }
    }

    /// Lets every command act whose time has come.
    fn apply_due(&mut self, out: &mut impl FnMut(Output)) {
        while let Some(on_air) = self.radio.front().copied().filter(|c| c.acts_at <= self.time) {
            self.radio.pop_front();
            self.act_on(&on_air.command);
            let stamps = Stamps { applied_at: on_air.acts_at, ..on_air.header.stamps };
            let vehicle = VehicleV1 {
                command_sequence: on_air.header.sequence,
                lost: self.commands_lost,
                battery_v: self.battery.voltage(),
                link_quality: f64::NAN,
                armed: u8::from(self.armed),
                link: 1,
                simulated: 1,
                ..VehicleV1::default()
            };
            out(Output::Applied(on_air.header.pose_sequence, stamps, vehicle));
        }
        if self.falls_silent_at.is_some_and(|at| at <= self.time) {
            self.act_on(&CommandV1::default());
        }
    }

    /// A vehicle takes what it understands and keeps to its limits; anything else is neutral.
    fn act_on(&mut self, command: &CommandV1) {
        let actuation = Actuation::from_code(command.actuation)
            .filter(|actuation| *actuation == self.understands)
            .unwrap_or(Actuation::Disarmed);
        self.armed = actuation != Actuation::Disarmed;
        self.falls_silent_at = self.armed.then(|| self.time + COMMAND_TIME_OUT);
        let limit = self.max_torque;
        let clamp =
            |value: f64, low: f64| if value.is_finite() { value.clamp(low, 1.0) } else { 0.0 };
        self.input = match actuation {
            Actuation::Disarmed => Input::default(),
            Actuation::Sticks => Input {
                sticks: Vector3::from(command.sticks).map(|stick| clamp(stick, -1.0)),
                thrust: clamp(command.thrust, 0.0),
                ..Input::default()
            },
            Actuation::Torque => Input {
                torque: Vector3::from(command.torque)
                    .map(|t| if t.is_finite() { t.clamp(-limit, limit) } else { 0.0 }),
                thrust: clamp(command.thrust, 0.0),
                ..Input::default()
            },
        };
    }

    /// Passes the grids whose instant is reached; the sample that they ask for.
    fn pass_grids(&mut self) -> Option<TruthV1> {
        let mut truth = None;
        if self.millisecond.next() <= self.time {
            self.millisecond.advance();
            self.gust.advance();
            truth = Some(self.truth());
        }
        if self.camera.next() <= self.time {
            self.camera.advance();
            truth = Some(TruthV1 { capture: self.camera.index(), ..self.truth() });
        }
        truth
    }

    fn integrate(&mut self, h: f64) {
        let disturbance = Disturbance {
            acceleration: self.gust.acceleration() + self.constant_acceleration,
            rate_drift: self.drift,
            voltage_ratio: self.battery.ratio(),
        };
        self.battery.draw(self.dynamics.thrust(&self.state), h);
        let before = self.state;
        self.state = self.dynamics.step(&before, h, &self.input, &disturbance);
        rest_on_floor(&before, &mut self.state);
    }
}
