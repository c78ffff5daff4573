//! Simulated vehicle, integrated from event to event: camera instants, milliseconds, commands that take effect.

use nalgebra::Vector3;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps, TruthV1, VehicleV1};
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_config::{Config, ProbeOptions};
use oqtal_control::quantity::{BodyRate, Torque};
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::Inertia;
use oqtal_runtime::actuation::actuation_of;

use crate::command_radio::CommandRadio;
use crate::disturbance::{LoadSchedule, SceneDisturbance};
use crate::dynamics::Dynamics;
use crate::gyroscope::Gyroscope;
use crate::input::{Disturbance, PlantInput};
use crate::spread::drawn;
use crate::state::State;
use crate::world::{BatteryModel, Gust, imperfections, rest_on_floor};

/// Rate of the integration grid \[Hz\]: the reciprocal of the longest step, and the rate at which gusts change.
const INTEGRATION_HZ: f64 = 1000.0;

/// Time without a command after which the vehicle stops its motors.
const COMMAND_TIME_OUT: Span = Span::from_millis(250);

/// Longest time that is integrated at once; after a longer pause, such as a suspension of the machine, the rest is skipped. It
/// exceeds the command time-out of the motors and the duration of a fall from indoor heights.
const LONGEST_PAUSE: Span = Span::from_millis(2000);

/// An output of the plant.
#[derive(Clone, Copy, Debug)]
pub enum PlantOutput {
    /// A sample of the truth.
    Truth(TruthV1),
    /// Command that took effect: sequence number of its pose, its stamps, state of the vehicle.
    Applied(u64, Stamps, VehicleV1),
}

/// Simulated vehicle and its radio. Pure: time is an argument.
#[derive(Clone, Debug)]
pub struct Plant {
    dynamics: Dynamics,
    state: State,
    time: Time,
    millisecond: Grid,
    /// Whether every millisecond has a sample of the truth.
    samples_milliseconds: bool,
    camera: Grid,
    gust: Gust,
    battery: BatteryModel,
    /// Model of the gyroscope; `None` for a vehicle that does not report its rates.
    gyroscope: Option<Gyroscope>,
    drift: Vector3<f64>,
    constant_acceleration: Vector3<f64>,
    loads: LoadSchedule,
    /// Mass \[kg\], drag \[1/s\] and inertia of the vehicle without payload.
    loaded: (f64, f64, Inertia),
    radio: CommandRadio,
    input: PlantInput,
    accepts: Actuation,
    max_torque: f64,
    thrust_exponent: f64,
    probe: ProbeOptions,
    /// Instant at which the motors stop unless a further command arrives; `None` while the motors are off.
    command_timeout_at: Option<Time>,
    armed: bool,
    /// Whether an operator's stop keeps the motors off.
    stopped: bool,
    last_command: u64,
    commands_lost: u64,
}

impl Plant {
    /// The vehicle of `config` on the floor at `start`.
    pub fn new(config: &Config, start: Time) -> Self {
        let seed = config.clock.seed;
        let options = drawn(&config.plant, seed);
        let (drift, constant_acceleration) = imperfections(&options, seed);
        Self {
            dynamics: Dynamics::new(&options),
            state: State::on_floor(),
            time: start,
            millisecond: Grid::new(start, INTEGRATION_HZ),
            samples_milliseconds: true,
            camera: Grid::new(start, options.frame_rate_hz),
            gust: Gust::new(&options, seed, 1.0 / INTEGRATION_HZ),
            battery: BatteryModel::new(&options),
            gyroscope: options.gyroscope.then(|| Gyroscope::new(seed)),
            drift,
            constant_acceleration,
            loads: LoadSchedule::new(&options),
            radio: CommandRadio::new(&options, seed),
            input: PlantInput::default(),
            accepts: actuation_of(options.interface),
            max_torque: options.max_torque_nm,
            loaded: (
                options.mass_kg,
                options.drag_per_s,
                options.inertia().expect("the configuration was checked"),
            ),
            thrust_exponent: options.thrust_exponent,
            probe: options.probe.clone(),
            command_timeout_at: None,
            armed: false,
            stopped: false,
            last_command: 0,
            commands_lost: 0,
        }
    }

    /// Disables the samples of the truth between camera frames: for flights whose truth is used only by the cameras, and by the
    /// recorder at the daemon's ticks.
    pub fn without_milliseconds(self) -> Self {
        Self { samples_milliseconds: false, ..self }
    }

    /// Removes the gyroscope: for flights in which no process reads the state of the vehicle. Its random numbers do not affect any other.
    pub fn remove_gyroscope(&mut self) {
        self.gyroscope = None;
    }

    /// Places the vehicle in the air with this motion, with the thrust of a hover, which the command `thrust` \[0..1\] holds.
    pub fn place(&mut self, motion: State, thrust: f64) {
        self.state = State { actuators: self.dynamics.hovering(), ..motion };
        let actuation = self.accepts.code();
        self.act_on(&CommandV1 { actuation, thrust, ..CommandV1::default() });
    }

    /// The next instant that other processes depend on: a camera frame, a command that takes effect, or a command time-out.
    pub fn next_event(&self) -> Time {
        let frame = self.camera.next();
        let effect = self.radio.next_effect().map_or(frame, |effect| effect.min(frame));
        self.command_timeout_at.map_or(effect, |timeout| timeout.min(effect))
    }

    /// The next instant at which observers expect a sample of the truth.
    pub fn next_sample(&self) -> Time {
        self.millisecond.next().min(self.next_event())
    }

    /// Keeps the motors off from now on, whatever is commanded, or ends that state. Commands in transit are discarded. Returns
    /// whether the state has changed.
    pub fn keep_stopped(&mut self, stopped: bool) -> bool {
        if stopped {
            self.radio.disarm();
            self.act_on(&CommandV1::default());
        }
        std::mem::replace(&mut self.stopped, stopped) != stopped
    }

    /// Takes a command from the bus at `now`; it takes effect after the radio's delay. `lost` is the total number of commands
    /// lost on the bus.
    pub fn receive(&mut self, now: Time, header: Header, command: CommandV1, lost: u64) {
        let mut header = header;
        header.stamps.received_at = now;
        self.commands_lost = lost;
        let command = if self.stopped { CommandV1::default() } else { command };
        self.radio.send(now, header, command);
    }

    /// Disturbs vehicle and radio from now on.
    pub fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.radio.disturb(disturbance.radio);
        self.loads.begin(disturbance.armed_at);
    }

    /// Applies `command` at once, for a vehicle that is not commanded over the bus. Produces no output.
    pub fn apply_command(&mut self, command: &CommandV1) {
        self.act_on(command);
    }

    /// Drives the rotors' motors at the powers that a firmware commands \[0..1\], until the next command or its time-out.
    pub fn drive(&mut self, motors: [f64; 4]) {
        self.armed = motors.iter().any(|power| *power > 0.0);
        self.command_timeout_at = Some(self.time + COMMAND_TIME_OUT);
        self.input = PlantInput { motors: Some(motors.into()), ..PlantInput::default() };
    }

    /// Battery voltage under load \[V\].
    pub fn battery_v(&self) -> f64 {
        self.battery.voltage()
    }

    /// Integrates to `until`, event by event in steps of at most a millisecond, and passes the outputs to `out`.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(PlantOutput)) {
        loop {
            self.apply_due(&mut out);
            let sampled = self.pass_grids();
            if let Some(truth) = sampled {
                out(PlantOutput::Truth(truth));
            }
            if self.time >= until {
                return;
            }
            let next = self.next_sample().min(until);
            // The equations of motion are smooth within a step.
            let next = self.loads.next_change(self.time).map_or(next, |change| next.min(change));
            self.integrate(next.since(self.time).seconds());
            self.time = next;
        }
    }

    /// Skips the excess of a pause of the process that ends at `now`; the vehicle does not move in it. Returns the skipped time.
    pub fn skip_pause(&mut self, now: Time) -> Span {
        let skipped = now.since(self.time) - LONGEST_PAUSE;
        if skipped <= Span::ZERO {
            return Span::ZERO;
        }
        self.advance(self.time + LONGEST_PAUSE, |_| ());
        self.time = now;
        self.millisecond.skip_to(now);
        self.camera.skip_to(now);
        skipped
    }

    /// The truth at the present instant.
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

    /// Body rate by the vehicle's gyroscope \[rad/s, body\]; `None` if it has none.
    pub fn measured_rate(&self) -> Option<[f64; 3]> {
        self.gyroscope.as_ref().map(|gyroscope| gyroscope.measure(self.time, &self.state.rate))
    }

    /// State of the vehicle.
    pub fn vehicle(&self) -> VehicleV1 {
        let rate = self.measured_rate();
        VehicleV1 {
            command_sequence: self.last_command,
            lost: self.commands_lost + self.radio.lost(),
            battery_v: self.battery.voltage(),
            link_quality: f64::NAN,
            estimate_position: [f64::NAN; 3],
            body_rate: rate.unwrap_or_default(),
            body_rate_at: rate.map_or(Time::UNSET, |_| self.time),
            armed: u8::from(self.armed),
            stopped: u8::from(self.stopped),
            link: 1,
            simulated: 1,
            ..VehicleV1::default()
        }
    }

    /// Applies the commands that are due.
    fn apply_due(&mut self, out: &mut impl FnMut(PlantOutput)) {
        while let Some((on_air, applied_at)) = self.radio.receive(self.time) {
            self.act_on(&on_air.command);
            let stamps = Stamps { applied_at, ..on_air.header.stamps };
            self.last_command = on_air.header.sequence;
            out(PlantOutput::Applied(on_air.header.pose_sequence, stamps, self.vehicle()));
        }
        if self.command_timeout_at.is_some_and(|at| at <= self.time) {
            self.act_on(&CommandV1::default());
        }
    }

    /// Applies a command within the vehicle's limits. A command of another interface disarms.
    fn act_on(&mut self, command: &CommandV1) {
        let actuation = Actuation::from_code(command.actuation)
            .filter(|actuation| *actuation == self.accepts)
            .unwrap_or(Actuation::Disarmed);
        self.armed = actuation != Actuation::Disarmed;
        self.command_timeout_at = self.armed.then(|| self.time + COMMAND_TIME_OUT);
        let limit = self.max_torque;
        let clamp =
            |value: f64, low: f64| if value.is_finite() { value.clamp(low, 1.0) } else { 0.0 };
        let thrust = clamp(command.thrust, 0.0).powf(self.thrust_exponent);
        let thrusting = PlantInput { thrust, ..PlantInput::default() };
        self.input = match actuation {
            Actuation::Disarmed => PlantInput::default(),
            Actuation::Sticks => {
                let sticks = Vector3::from(command.sticks).map(|stick| clamp(stick, -1.0));
                let sticks = sticks + self.probed();
                PlantInput { sticks, ..thrusting }
            }
            Actuation::Torque => {
                let torque = Vector3::from(command.torque)
                    .map(|t| if t.is_finite() { t.clamp(-limit, limit) } else { 0.0 });
                PlantInput { torque, ..thrusting }
            }
            // Numbers that are not an attitude are replaced by level.
            Actuation::Attitude => {
                let attitude = Attitude::from_xyzw(command.attitude).unwrap_or_default();
                PlantInput { attitude: **attitude.unit_quaternion(), ..thrusting }
            }
        };
    }

    /// Addition of the probe to the sticks of a command that takes effect now \[-\].
    fn probed(&self) -> Vector3<f64> {
        let ProbeOptions { stick, amplitude, frequency_hz } = self.probe;
        let mut added = Vector3::zeros();
        if amplitude > 0.0 {
            let turns = frequency_hz * self.time.since(Time::VIRTUAL_START).seconds();
            added[stick - 1] = amplitude * (std::f64::consts::TAU * turns).sin();
        }
        added
    }

    /// Advances the sampling grids that are due, and returns the sample for them.
    fn pass_grids(&mut self) -> Option<TruthV1> {
        let mut truth = None;
        if self.millisecond.next() <= self.time {
            self.millisecond.advance();
            self.gust.advance();
            truth = self.samples_milliseconds.then(|| self.truth());
        }
        if self.camera.next() <= self.time {
            self.camera.advance();
            truth = Some(TruthV1 { capture: self.camera.index(), ..self.truth() });
        }
        truth
    }

    fn integrate(&mut self, h: f64) {
        let disturbance = self.disturbance();
        self.battery.draw(self.dynamics.thrust(&self.state), h);
        let before = (self.state.position, self.state.attitude);
        self.dynamics.advance(&mut self.state, h, &self.input, &disturbance);
        rest_on_floor(before, &mut self.state);
    }

    /// Disturbance of the vehicle from the present instant to the next event.
    fn disturbance(&self) -> Disturbance {
        let calm = Disturbance {
            acceleration: self.gust.acceleration() + self.constant_acceleration,
            rate_drift: self.drift,
            angular_acceleration: Vector3::zeros(),
            wind: Vector3::zeros(),
            mass_ratio: 1.0,
            voltage_ratio: self.battery.ratio(),
        };
        let Some(load) = self.loads.at(self.time) else { return calm };
        let (mass_kg, drag_per_s, inertia) = &self.loaded;
        let mass_ratio = mass_kg / (mass_kg + load.mass_kg);
        let wind = load.wind * *drag_per_s;
        let forces = self.constant_acceleration + load.force / *mass_kg + wind;
        let torque = inertia.acceleration(BodyRate(Vector3::zeros()), Torque(load.torque));
        Disturbance {
            acceleration: self.gust.acceleration() + forces * mass_ratio,
            angular_acceleration: torque.0,
            wind: load.wind,
            mass_ratio,
            ..calm
        }
    }
}
