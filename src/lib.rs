//! The front door of oqtal: flies, judges and shows.
// Shared memory of a bare futex, in `latency/bare/shared.rs`.
#![deny(unsafe_code)]

pub mod campaign;
pub mod check;
mod child;
pub mod cli;
pub mod csv;
pub mod ctl;
pub mod doctor;
pub mod flight;
pub mod fly;
pub mod kernel;
pub mod latency;
pub mod recorder;
pub mod report;
pub mod reproduce;
pub mod summary;
pub mod table;
pub mod tune;
pub mod wire;
