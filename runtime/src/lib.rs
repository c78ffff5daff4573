//! What every process of oqtal has: context, real-time set-up, loop clock, virtual clock, health, logs, signals, exit codes.
#![forbid(unsafe_code)]

pub mod health;
mod log;
pub mod loop_clock;
pub mod process;
pub mod program;
pub mod random;
pub mod realtime;
pub mod service;
pub mod virtual_clock;
