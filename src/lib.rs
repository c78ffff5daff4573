//! The front door of oqtal: one module a command.
#![forbid(unsafe_code)]

pub mod check;
mod child;
pub mod cli;
pub mod ctl;
pub mod doctor;
pub mod fly;
pub mod latency;
mod provenance;
