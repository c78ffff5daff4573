//! Position laws of the literature with which `oqtal-dt` is compared. The daemon does not link them: studies fly them in one process.
//!
//! | file | subject |
//! |---|---|
//! | [`nmpc`] | nonlinear model predictive control of the position (Sun et al. 2022) |
//! | [`dfbc`] | control by differential flatness with incremental inversion (Sun et al. 2022) |
//! | [`l1`] | geometric control with L1 adaptation (Lee et al. 2010, Wu et al. 2025) |
//! | [`law`] | the interface: what a law is given in a tick, and what it answers |
//! | [`flat`] | motion and input of a vehicle on its reference |
//! | [`increment`] | the error of the rate command from the measured angular acceleration, the part of INDI that `nmpc` and `dfbc` share |
//! | [`program`] | the quadratic program of `nmpc` and its solver |
//!
//! Every law commands body rates and thrust, and knows the model of the vehicle: mass, drag and the lags of rate and thrust. No step
//! allocates. Units and frames are those of `oqtal-control`.
#![forbid(unsafe_code)]

pub mod dfbc;
pub mod flat;
pub mod increment;
pub mod l1;
pub mod law;
pub mod nmpc;
pub mod program;
