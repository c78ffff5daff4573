//! Lander of Table I in the gravity turn under an attitude law: the paper's simulation, without delay or noise.

use nalgebra::{Quaternion, Vector3, Vector4};
use oqtal_config::{Config, Setting, VehicleOptions};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ControlOptions, Controller, TorqueInput,
};
use oqtal_control::gravity_turn::{GravityTurn, Guidance, GuidanceOptions};
use oqtal_control::metrics::{MetricSample, TableTwo};
use oqtal_control::options::OptionError;
use oqtal_control::position::attitude_along;
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeError;
use oqtal_plant_sim::{Disturbance, Dynamics, PlantInput, State};
use oqtal_runtime::process::Failure;
use oqtal_runtime::random::{RandomSource, normal3, stream};

/// Table I: simulated time \[s\].
pub const DURATION_S: f64 = 23.0;
/// Table I: rate of the loop \[Hz\].
pub const RATE_HZ: f64 = 60.0;
/// Table I: thrust over weight \[-\].
const THRUST_RATIO: f64 = 1.5;
/// Table I: initial speed \[m/s\].
const SPEED_M_S: f64 = 70.0;
/// Table I: initial altitude \[m\].
const ALTITUDE_M: f64 = 2000.0;
/// No torque limit, as in the paper \[N m\].
const NO_LIMIT_NM: f64 = 1e9;
/// Maximum integration step \[s\].
const LONGEST_STEP_S: f64 = 1.0 / 240.0;
/// Standard deviation of the measured attitude \[rad\], of the size of rounding errors. Without it the turn would stay exactly in
/// its plane, and laws with a cell border or a singularity there would appear better than they are.
const ROUNDING_RAD: f64 = 1e-15;
/// Seed of the noise of the measured attitude.
const NOISE_SEED: u64 = 1;
/// Rate above which a body counts as out of control \[rad/s\].
const FASTEST_RAD_S: f64 = 1e4;

/// Conditions of the gravity turn, except the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// Rate of the loop \[Hz\]; the torque is held between ticks.
    pub rate_hz: f64,
    /// Whether `omega_d` is commanded together with the attitude.
    pub rates: bool,
    /// Speed below which the commanded attitude is constant \[m/s\].
    pub least_speed_m_s: f64,
    /// Standard deviation of the measured attitude about each axis \[rad, body\].
    pub noise_rad: f64,
}

impl Default for Descent {
    fn default() -> Self {
        Self { rate_hz: RATE_HZ, rates: true, least_speed_m_s: 1.0, noise_rad: ROUNDING_RAD }
    }
}

/// One tick of a descent.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Time since the start \[s\].
    pub time_s: f64,
    /// State of the vehicle.
    pub state: State,
    /// Commanded attitude.
    pub desired: AttitudeReference,
    /// Commanded torque \[N m, body\].
    pub torque: Vector3<f64>,
}

/// Vehicle of Table I.
#[derive(Clone, Debug)]
pub struct Lander {
    vehicle: VehicleOptions,
    dynamics: Dynamics,
    turn: GravityTurn,
}

impl Lander {
    /// Lander of the configuration preset that contains Table I.
    ///
    /// # Errors
    /// The environment sets an invalid vehicle.
    pub fn new() -> Result<Self, Failure> {
        let preset = Setting::flag("spacecraft", "vehicle.preset", "spacecraft");
        let Config { vehicle, plant, .. } = Config::from_settings(&[preset])?;
        let angle = std::f64::consts::FRAC_PI_2;
        let turn = GravityTurn::new(THRUST_RATIO, vehicle.gravity_m_s2, SPEED_M_S, angle)
            .expect("Table I is a gravity turn");
        Ok(Self { dynamics: Dynamics::new(&plant), vehicle, turn })
    }

    /// The ideal turn.
    pub fn turn(&self) -> &GravityTurn {
        &self.turn
    }

    /// Torque input of the vehicle, unlimited as in the paper or limited as configured.
    ///
    /// # Panics
    /// Never: the preset is a valid vehicle.
    pub fn input(&self, limited: bool) -> TorqueInput {
        let inertia = self.vehicle.inertia().expect("a test holds the preset");
        let most = if limited { self.vehicle.max_torque_nm } else { NO_LIMIT_NM };
        TorqueInput::new(inertia, most).expect("both limits are positive")
    }

    /// Position of the ideal turn at `time_s` \[m, world\].
    pub fn ideal(&self, time_s: f64) -> Vector3<f64> {
        let ideal = self.turn.at_time(time_s);
        Vector3::new(-ideal.down_range_m, 0.0, ALTITUDE_M - ideal.drop_m)
    }

    /// Initial state, without rotation. The turn goes towards -x, so that its pitch begins at +90 degrees as in the paper, whose
    /// rule for cells depends on the sign.
    fn start(&self) -> State {
        let velocity = Vector3::new(-SPEED_M_S, 0.0, 0.0);
        State {
            position: Vector3::new(0.0, 0.0, ALTITUDE_M),
            velocity,
            attitude: *attitude_along(&-velocity, 0.0).unit_quaternion().quaternion(),
            rate: Vector3::zeros(),
            actuators: Vector4::x() * self.vehicle.max_thrust_n,
        }
    }

    /// State with this rate \[rad/s, body\], zero velocity and full thrust.
    pub fn turning(&self, attitude: &Attitude, rate: Vector3<f64>) -> State {
        let attitude = *attitude.unit_quaternion().quaternion();
        State { attitude, rate, velocity: Vector3::zeros(), ..self.start() }
    }

    /// Flies the turn under the law of `options` and passes every tick to `watch`. `None` if the law loses control.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn fly(
        &self,
        options: &ControlOptions,
        descent: &Descent,
        watch: impl FnMut(&Moment),
    ) -> Result<Option<TableTwo>, OptionError> {
        let options = ControlOptions { rate_hz: descent.rate_hz, ..*options };
        let law = Controller::new(&options, self.input(false))?;
        Ok(self.descend(law, descent, watch))
    }

    fn descend(
        &self,
        mut law: Controller<TorqueInput>,
        descent: &Descent,
        mut watch: impl FnMut(&Moment),
    ) -> Option<TableTwo> {
        let mut guidance = Guidance::new(GuidanceOptions {
            thrust_ratio: THRUST_RATIO,
            gravity_m_s2: self.vehicle.gravity_m_s2,
            least_speed_m_s: descent.least_speed_m_s,
            rates: descent.rates,
        });
        let mut noise = stream(NOISE_SEED, RandomSource::Cameras);
        let dt_s = 1.0 / descent.rate_hz;
        let (mut state, mut metrics) = (self.start(), TableTwo::default());
        for tick in 0..(DURATION_S * descent.rate_hz).round() as u32 {
            let time_s = f64::from(tick) * dt_s;
            let body = attitude_state(&state);
            let desired = guidance.command(&state.velocity, &body.attitude);
            let off = normal3(&mut noise) * descent.noise_rad;
            let measured = AttitudeState { attitude: body.attitude.turned_by(off), ..body };
            let torque = law.update(&measured, &desired, dt_s).0;
            watch(&Moment { time_s, state, desired, torque });
            let error = AttitudeError::between(&desired.attitude, &body.attitude);
            let sample = MetricSample {
                position_error: self.ideal(time_s) - state.position,
                quaternion_error: *error.eps(),
                input: torque,
            };
            metrics.add(&sample, dt_s);
            state = self.hold(&state, torque, dt_s);
            if !is_under_control(&state) {
                return None;
            }
        }
        metrics.riccati_solves = u64::from(law.riccati_solves());
        Some(metrics)
    }

    /// State after applying `torque` \[N m, body\] and full thrust for `dt_s` \[s\].
    pub fn hold(&self, state: &State, torque: Vector3<f64>, dt_s: f64) -> State {
        let input = PlantInput { torque, thrust: 1.0, ..PlantInput::default() };
        let calm = Disturbance::NONE;
        let steps = (dt_s / LONGEST_STEP_S - 1e-9).ceil().max(1.0);
        let mut state = *state;
        for _ in 0..steps as u32 {
            self.dynamics.advance(&mut state, dt_s / steps, &input, &calm);
        }
        state
    }
}

/// Attitude and rate of a body in the form that laws take.
pub fn attitude_state(state: &State) -> AttitudeState {
    let Quaternion { coords } = state.attitude;
    let attitude = Attitude::from_xyzw(coords.into()).unwrap_or_default();
    AttitudeState { attitude, rate: BodyRate(state.rate) }
}

/// Whether the state of a body is finite and its rate below the limit.
pub fn is_under_control(state: &State) -> bool {
    let finite =
        state.position.iter().chain(&state.attitude.coords).all(|number| number.is_finite());
    finite && state.rate.norm() < FASTEST_RAD_S
}
