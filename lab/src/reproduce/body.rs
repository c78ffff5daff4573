//! A body that only turns, under an attitude law: the spacecraft of Table I, or the quadrotor with its rate loop.

use nalgebra::Vector3;
use oqtal_config::{Config, Setting, Vehicle};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, Controller, ControllerName, ControllerOptions, RateInput,
};
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_plant_sim::{Disturbance, Dynamics, Input, State};
use oqtal_runtime::process::Failure;

use super::lander::{Lander, RATE_HZ, attitude_state, is_under_control};

/// Steps of the integrator between two ticks.
const STEPS: u32 = 4;

/// A body and how it is commanded.
#[derive(Clone, Debug)]
pub enum Body {
    /// Torque in; limited to what the vehicle can do, or not.
    Spacecraft(Box<Lander>, bool),
    /// Sticks in.
    Quadrotor(Box<Vehicle>),
}

/// One tick of a turn.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// Since the start \[s\].
    pub time_s: f64,
    /// Attitude of the body.
    pub attitude: Attitude,
    /// Its rate \[rad/s, body\].
    pub rate: Vector3<f64>,
    /// What the law commands \[N m or -1..1, body\].
    pub input: Vector3<f64>,
}

/// A turn from a state to rest at a target.
#[derive(Clone, Copy, Debug)]
pub struct Manoeuvre {
    /// Attitude at the start.
    pub attitude: Attitude,
    /// Rate at the start \[rad/s, body\].
    pub rate: Vector3<f64>,
    /// Attitude to be held.
    pub target: Attitude,
    /// How long \[s\].
    pub duration_s: f64,
}

/// What came of a turn.
#[derive(Clone, Debug)]
pub struct Turned {
    /// Every tick, until control was lost.
    pub ticks: Vec<Turn>,
    /// Whether every command was a number.
    pub commands_finite: bool,
    /// Riccati equations solved.
    pub riccati_solves: u32,
    /// Of them, those without a solution.
    pub failed_solves: u32,
}

impl Body {
    /// The quadrotor of the shipped configuration.
    ///
    /// # Errors
    /// The environment sets a vehicle that is none.
    pub fn quadrotor() -> Result<Self, Failure> {
        let kind = Setting::flag("quadrotor", "vehicle.kind", "hummingbird");
        Ok(Self::Quadrotor(Box::new(Config::from_settings(&[kind])?.vehicle)))
    }

    /// Turns the body under the law of `options`, 60 times a second.
    ///
    /// # Errors
    /// An option of the law has no meaning.
    pub fn turn(
        &self,
        options: &ControllerOptions,
        manoeuvre: &Manoeuvre,
    ) -> Result<Turned, OptionError> {
        match self {
            Self::Spacecraft(lander, limited) => {
                let law = Controller::new(options, lander.input(*limited))?;
                let start = lander.turning(&manoeuvre.attitude, manoeuvre.rate);
                Ok(follow(law, start, manoeuvre, |state, torque| {
                    (torque.0, lander.hold(state, torque.0, 1.0 / RATE_HZ))
                }))
            }
            Self::Quadrotor(vehicle) => {
                let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s))?;
                // As the daemon builds it: the paper's laws do not know of the lag.
                let input = match options.controller {
                    ControllerName::OqtalDt => {
                        input.with_lag(vehicle.rate_lag_ms * 1e-3, 1.0 / RATE_HZ)?
                    }
                    _ => input,
                };
                let law = Controller::new(options, input)?;
                let dynamics = Dynamics::new(vehicle);
                let attitude = *manoeuvre.attitude.unit_quaternion().quaternion();
                let start = State { attitude, rate: manoeuvre.rate, ..State::on_floor() };
                Ok(follow(law, start, manoeuvre, |state, sticks| {
                    (sticks.0, hold(&dynamics, state, sticks.0))
                }))
            }
        }
    }
}

/// The state after `sticks` have been held for a tick.
fn hold(dynamics: &Dynamics, state: &State, sticks: Vector3<f64>) -> State {
    let input = Input { sticks, ..Input::default() };
    let calm = Disturbance {
        acceleration: Vector3::zeros(),
        rate_drift: Vector3::zeros(),
        voltage_ratio: 1.0,
    };
    (0..STEPS).fold(*state, |state, _| {
        dynamics.step(&state, 1.0 / RATE_HZ / f64::from(STEPS), &input, &calm)
    })
}

/// Turns a body from `start` under `law`; `obey` gives the numbers of a command, and the state after a tick of it.
fn follow<L: AttitudeLaw>(
    mut law: L,
    start: State,
    manoeuvre: &Manoeuvre,
    obey: impl Fn(&State, L::Command) -> (Vector3<f64>, State),
) -> Turned {
    let mut state = start;
    let target = AttitudeReference { attitude: manoeuvre.target, ..Default::default() };
    let (mut ticks, mut commands_finite) = (Vec::new(), true);
    for tick in 0..(manoeuvre.duration_s * RATE_HZ).round() as u32 {
        let body = attitude_state(&state);
        let (input, next) = obey(&state, law.update(&body, &target, 1.0 / RATE_HZ));
        commands_finite &= input.iter().all(|number| number.is_finite());
        let time_s = f64::from(tick) / RATE_HZ;
        ticks.push(Turn { time_s, attitude: body.attitude, rate: state.rate, input });
        state = next;
        if !is_under_control(&state) {
            break;
        }
    }
    Turned {
        ticks,
        commands_finite,
        riccati_solves: law.riccati_solves(),
        failed_solves: law.failed_solves(),
    }
}
