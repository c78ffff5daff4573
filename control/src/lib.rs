//! The mathematics of OQTAL: pure functions and small state machines over static matrices.
//!
//! No clock, no I/O, no thread, no allocation in a step; time arrives as an argument. Equation numbers are those of
//! OQTAL (IEEE TAES 2015); where the printed equation is wrong the line cites the erratum in `docs/errata.md`.
#![forbid(unsafe_code)]

mod control_options;
pub mod controller;
pub mod error_model;
pub mod estimator;
pub mod euler;
pub mod gravity_turn;
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
pub mod tracking_error;
pub mod trajectory;
pub mod tuning;

pub use control_options::ControlOptions;
