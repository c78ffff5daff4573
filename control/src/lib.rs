//! Attitude and position control of flying bodies: an optimal quaternion law and other laws for comparison, Riccati solvers,
//! estimation, prediction and trajectories, as pure functions and small state machines over matrices of static size.
//!
//! The crate has no clock, no input or output, no thread and no `unsafe` code; time is an argument, and no step allocates.
//! Its dependencies are nalgebra and serde.
//!
//! # From a problem to a type
//!
//! | I want to … | type or function | example |
//! |---|---|---|
//! | hold or turn an attitude | [`controller::Controller`], one of eight laws behind [`controller::AttitudeLaw`] | `attitude_loop` |
//! | use the paper's law itself, Eq. (56) | [`controller::Oqtal`] | `attitude_loop` |
//! | command torques, or body rates by sticks | [`controller::TorqueInput`], [`controller::RateInput`] | `attitude_loop` |
//! | write a law of my own | [`controller::AttitudeLaw`], [`controller::InputForm`], [`tracking_error::AttitudeError`] | |
//! | compute the gain of a linear-quadratic regulator | [`riccati::care`], [`riccati::dare`] | `riccati` |
//! | sample a continuous-time system | [`linear::discretise`] | `riccati` |
//! | fly through a known delay, with noise and wind | [`predictive::Autopilot`] | `predictive` |
//! | estimate velocity and body rate from poses | [`estimator::Estimator`] | |
//! | turn a position reference into attitude and thrust | [`position::PositionLoops`] | |
//! | plan a flight, or follow waypoints | [`trajectory::FlightPlan`], [`trajectory::Waypoints`] | |
//! | compute the motion of a rigid body | [`rigid_body::Inertia`], [`rigid_body::quaternion_rate`] | `attitude_loop` |
//! | change between quaternions and Euler angles | [`quaternion::Attitude`], [`euler::EulerAngles`] | |
//! | land on a gravity turn, Eqs. (58) to (60) | [`gravity_turn::GravityTurn`] | |
//! | score a flight | [`metrics::Statistics`], [`metrics::TableTwo`] | |
//! | evaluate a sample: quantiles, correlation, intervals | [`statistics`] | |
//! | read options from a file and refuse bad ones | [`ControlOptions`], [`options::OptionError`] | |
//!
//! The examples are in the folder `examples`: `cargo run --example attitude_loop`.
//!
//! ```
//! use nalgebra::Vector3;
//! use oqtal_control::controller::{
//!     AttitudeLaw, AttitudeReference, AttitudeState, Controller, ControlOptions, RateInput,
//! };
//!
//! // Full stick turns this vehicle at 2 rad/s about each axis.
//! let mut law = Controller::new(&ControlOptions::default(), RateInput::new(Vector3::repeat(2.0))?)?;
//! let (state, reference) = (AttitudeState::default(), AttitudeReference::default());
//! let sticks = law.update(&state, &reference, 1.0 / 60.0);
//! assert_eq!(sticks.0, Vector3::zeros());
//! # Ok::<(), oqtal_control::options::OptionError>(())
//! ```
//!
//! # Conventions
//!
//! SI units, radians, `f64`. World: right-handed, z up. Body: x forward, y left, z up. Attitudes are unit quaternions, scalar
//! last, body to world. Every public number states its unit and frame: \[m/s, world\]; \[-\] for none.
//!
//! Equation numbers are those of OQTAL (*IEEE Transactions on Aerospace and Electronic Systems*, 2015). Where a printed equation
//! is wrong, the line names its erratum in `docs/errata.md` of the repository. Mathematics that is not in the paper is marked as
//! such.
#![forbid(unsafe_code)]

pub mod controller;
pub mod error_model;
pub mod estimator;
pub mod euler;
pub mod gravity_turn;
pub mod horizon;
pub mod integral;
pub mod linear;
pub mod metrics;
pub mod options;
pub mod position;
pub mod predictive;
pub mod quantity;
pub mod quaternion;
pub mod riccati;
pub mod rigid_body;
pub mod scalar_pid;
pub mod schedule;
pub mod statistics;
pub mod tracking_error;
pub mod trajectory;

pub use controller::{ControlOptions, LawStack};
