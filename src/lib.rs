//! The front door of oqtal: one module a command.
// Shared memory of a bare futex, in `latency/bare/shared.rs`.
#![deny(unsafe_code)]

pub mod check;
mod child;
pub mod cli;
pub mod ctl;
pub mod doctor;
pub mod fly;
pub mod latency;
