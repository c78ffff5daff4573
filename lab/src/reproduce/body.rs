//! Rotating body under an attitude law: the spacecraft of Table I, or the quadrotor with its rate loop.

use nalgebra::Vector3;
use oqtal_config::{Config, Setting};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, ControlOptions, Controller, ControllerName, RateInput,
};
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_plant_sim::{Disturbance, Dynamics, PlantInput, State};
use oqtal_runtime::process::Failure;

use super::lander::{Lander, RATE_HZ, attitude_state, is_under_control};

/// Number of integration steps between two ticks.
const STEPS: u32 = 4;

/// Rotating body, by its kind of command.
#[derive(Clone, Debug)]
pub enum RotatingBody {
    /// Commanded by torque; limited to the vehicle's maximum if the flag is set.
    Spacecraft(Box<Lander>, bool),
    /// Commanded by sticks.
    Quadrotor(Box<Config>),
}

/// One tick of a manoeuvre.
#[derive(Clone, Copy, Debug)]
pub struct ManoeuvreTick {
    /// Time since the start \[s\].
    pub time_s: f64,
    /// Attitude \[body to world\].
    pub attitude: Attitude,
    /// Rate \[rad/s, body\].
    pub rate: Vector3<f64>,
    /// Command \[N m or -1..1, body\].
    pub input: Vector3<f64>,
}

/// A manoeuvre from an initial state to rest at a target attitude.
#[derive(Clone, Copy, Debug)]
pub struct Manoeuvre {
    /// Attitude at the start.
    pub attitude: Attitude,
    /// Rate at the start \[rad/s, body\].
    pub rate: Vector3<f64>,
    /// Attitude to be held.
    pub target: Attitude,
    /// Duration \[s\].
    pub duration_s: f64,
}

/// The record of a manoeuvre.
#[derive(Clone, Debug)]
pub struct ManoeuvreRecord {
    /// All ticks until control was lost.
    pub ticks: Vec<ManoeuvreTick>,
    /// Whether every command was finite.
    pub commands_finite: bool,
    /// Riccati equations solved.
    pub riccati_solves: u32,
    /// Riccati equations without a solution, included in `riccati_solves`.
    pub failed_solves: u32,
}

impl RotatingBody {
    /// The quadrotor of the shipped configuration.
    ///
    /// # Errors
    /// The environment sets an invalid vehicle.
    pub fn quadrotor() -> Result<Self, Failure> {
        let kind = Setting::flag("quadrotor", "vehicle.preset", "hummingbird");
        Ok(Self::Quadrotor(Box::new(Config::from_settings(&[kind])?)))
    }

    /// Simulates the manoeuvre under the law of `options` at 60 Hz.
    ///
    /// # Errors
    /// An option of the law is invalid.
    pub fn turn(
        &self,
        options: &ControlOptions,
        manoeuvre: &Manoeuvre,
    ) -> Result<ManoeuvreRecord, OptionError> {
        match self {
            Self::Spacecraft(lander, limited) => {
                let law = Controller::new(options, lander.input(*limited))?;
                let start = lander.turning(&manoeuvre.attitude, manoeuvre.rate);
                Ok(follow(law, start, manoeuvre, |state, torque| {
                    (torque.0, lander.hold(state, torque.0, 1.0 / RATE_HZ))
                }))
            }
            Self::Quadrotor(config) => {
                let vehicle = &config.vehicle;
                let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s))?;
                // As in the daemon, only `oqtal-dt` models the lag of the rate loop.
                let input = match options.controller {
                    ControllerName::OqtalDt => {
                        input.with_lag(vehicle.rate_lag_ms * 1e-3, 1.0 / RATE_HZ)?
                    }
                    _ => input,
                };
                let law = Controller::new(options, input)?;
                let dynamics = Dynamics::new(&config.plant);
                let attitude = *manoeuvre.attitude.unit_quaternion().quaternion();
                let start = State { attitude, rate: manoeuvre.rate, ..State::on_floor() };
                Ok(follow(law, start, manoeuvre, |state, sticks| {
                    (sticks.0, hold(&dynamics, state, sticks.0))
                }))
            }
        }
    }
}

/// State after applying `sticks` for one tick.
fn hold(dynamics: &Dynamics, state: &State, sticks: Vector3<f64>) -> State {
    let input = PlantInput { sticks, ..PlantInput::default() };
    let calm = Disturbance::NONE;
    let mut state = *state;
    for _ in 0..STEPS {
        dynamics.advance(&mut state, 1.0 / RATE_HZ / f64::from(STEPS), &input, &calm);
    }
    state
}

/// Simulates a manoeuvre from `start` under `law`; `obey` returns a command as a vector, and the state after one tick with it.
fn follow<L: AttitudeLaw>(
    mut law: L,
    start: State,
    manoeuvre: &Manoeuvre,
    obey: impl Fn(&State, L::Command) -> (Vector3<f64>, State),
) -> ManoeuvreRecord {
    let mut state = start;
    let target = AttitudeReference { attitude: manoeuvre.target, ..Default::default() };
    let (mut ticks, mut commands_finite) = (Vec::new(), true);
    for tick in 0..(manoeuvre.duration_s * RATE_HZ).round() as u32 {
        let body = attitude_state(&state);
        let (input, next) = obey(&state, law.update(&body, &target, 1.0 / RATE_HZ));
        commands_finite &= input.iter().all(|number| number.is_finite());
        let time_s = f64::from(tick) / RATE_HZ;
        ticks.push(ManoeuvreTick { time_s, attitude: body.attitude, rate: state.rate, input });
        state = next;
        if !is_under_control(&state) {
            break;
        }
    }
    ManoeuvreRecord {
        ticks,
        commands_finite,
        riccati_solves: law.riccati_solves(),
        failed_solves: law.failed_solves(),
    }
}
