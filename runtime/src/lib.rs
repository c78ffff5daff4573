//! What every process of oqtal has: context, real-time set-up, loop clock, virtual clock, health, logs, signals, exit codes.
#![forbid(unsafe_code)]

pub mod actuation;
mod args;
pub mod background;
mod context;
mod exit;
pub mod faults;
pub mod files;
pub mod handoff;
pub mod health;
mod lockstep;
mod log;
pub mod loop_clock;
pub mod overrun;
pub mod pose_source;
pub mod process;
pub mod process_loop;
pub mod program;
pub mod random;
pub mod realtime;
mod service;
pub mod stop;
pub mod turn;
pub mod virtual_clock;
