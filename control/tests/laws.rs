//! Properties of the attitude laws: of every law in both input forms unless a test says otherwise.

#[path = "laws/closed_loop.rs"]
mod closed_loop;
#[path = "laws/discrete.rs"]
mod discrete;
#[path = "laws/gains.rs"]
mod gains;
#[path = "laws/geometric.rs"]
mod geometric;
#[path = "laws/golden_gains.rs"]
mod golden_gains;
#[path = "laws/robustness.rs"]
mod robustness;
#[path = "laws/set_point.rs"]
mod set_point;
#[path = "laws/solves.rs"]
mod solves;

use nalgebra::{Matrix3, Vector3};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ControlOptions, Controller, ControllerName,
    InputForm, LawTerms, RateFeedback, RateInput, TorqueInput,
};
use oqtal_control::quantity::{AngularAcceleration, BodyRate, StickCommand, Torque};
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::Inertia;
use oqtal_control::schedule::Cells;
use proptest::prelude::*;

const DT_S: f64 = 1.0 / 60.0;
const MAX_TORQUE: f64 = 20.0;
/// Every registered law. A new law takes part in these tests at once.
const ALL: [ControllerName; ControllerName::ALL.len()] = ControllerName::ALL;
/// The laws with integral action.
const INTEGRATING: [ControllerName; 4] =
    [ControllerName::Pid, ControllerName::Lqr, ControllerName::Oqtal, ControllerName::Geometric];
/// The laws whose gain is the solution of a Riccati equation at an operating point.
const SCHEDULED: [ControllerName; 2] = [ControllerName::Lqr, ControllerName::Oqtal];

/// A command as numbers, so that one test covers both input forms.
trait Numbers {
    fn numbers(&self) -> Vector3<f64>;
}

impl Numbers for Torque {
    fn numbers(&self) -> Vector3<f64> {
        self.0
    }
}

impl Numbers for StickCommand {
    fn numbers(&self) -> Vector3<f64> {
        self.0
    }
}

/// An input form whose commands can be read as numbers.
trait Form: InputForm<Command: Numbers> + Copy + PartialEq + std::fmt::Debug {}
impl<I: InputForm<Command: Numbers> + Copy + PartialEq + std::fmt::Debug> Form for I {}

fn sticks() -> RateInput {
    RateInput::new(Vector3::repeat(2.0)).unwrap()
}

/// The spacecraft of Table I.
fn spacecraft() -> TorqueInput {
    TorqueInput::new(isotropic_inertia(), MAX_TORQUE).unwrap()
}

fn isotropic_inertia() -> Inertia {
    Inertia::new(Matrix3::from_diagonal_element(0.5)).unwrap()
}

fn uneven_inertia() -> Inertia {
    Inertia::new(Matrix3::new(0.6, 0.05, -0.02, 0.05, 0.5, 0.03, -0.02, 0.03, 0.7)).unwrap()
}

fn law<I: Form>(name: ControllerName, options: &ControlOptions, input: I) -> Controller<I> {
    Controller::new(&ControlOptions { controller: name, ..*options }, input).unwrap()
}

/// Options with which every law feeds back the rate error and nothing is fed forward.
fn with_rate_error(mut options: ControlOptions) -> ControlOptions {
    options.pid.rate = RateFeedback::OmegaE;
    options.lqr.rate = RateFeedback::OmegaE;
    options.geometric.feed_forward = false;
    options
}

fn without_integral_action(mut options: ControlOptions) -> ControlOptions {
    options.pid.integral_time_s = f64::INFINITY;
    options.lqr.integral_weight = 0.0;
    options.oqtal.integral_weight = 0.0;
    options.geometric.integral_gain_per_s = 0.0;
    options
}

fn with_cells(mut options: ControlOptions, cells: Cells, delta: f64) -> ControlOptions {
    (options.lqr.cells, options.oqtal.cells) = (cells, cells);
    options.lqr = options.lqr.with_cell_width(delta);
    options.oqtal = options.oqtal.with_cell_width(delta);
    options
}

/// The command of a law that has not been used, for a body at `state`.
fn first_command<I: Form>(
    mut law: Controller<I>,
    state: &AttitudeState,
    reference: &AttitudeReference,
) -> Vector3<f64> {
    law.update(state, reference, DT_S).numbers()
}

fn at_rest(attitude: Attitude) -> AttitudeState {
    AttitudeState { attitude, rate: BodyRate::default() }
}

fn resting(attitude: Attitude) -> AttitudeReference {
    AttitudeReference { attitude, ..AttitudeReference::default() }
}

/// A vector of length up to `longest` in any direction.
fn vector(longest: f64) -> impl Strategy<Value = Vector3<f64>> {
    (prop::array::uniform3(-1.0..1.0_f64), 0.0..=longest)
        .prop_filter_map("no direction", |(direction, length)| {
            Vector3::from(direction).try_normalize(1e-3).map(|d| d * length)
        })
}

fn attitude() -> impl Strategy<Value = Attitude> {
    vector(std::f64::consts::PI).prop_map(Attitude::from_rotation_vector)
}

fn state() -> impl Strategy<Value = AttitudeState> {
    (attitude(), vector(3.0))
        .prop_map(|(attitude, rate)| AttitudeState { attitude, rate: BodyRate(rate) })
}

fn reference() -> impl Strategy<Value = AttitudeReference> {
    (attitude(), vector(2.0), vector(2.0)).prop_map(|(attitude, rate, acceleration)| {
        AttitudeReference {
            attitude,
            rate: BodyRate(rate),
            acceleration: AngularAcceleration(acceleration),
        }
    })
}
