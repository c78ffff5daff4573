//! How the processes of oqtal meet: messages, topics, ports, time, latency, configuration, the process shell.
// Two borrows in `wake.rs`: of a file descriptor, and of a word in shared memory.
#![deny(unsafe_code)]

pub mod bus;
pub mod code;
pub mod conductor;
pub mod config;
pub mod control;
pub mod error;
pub mod health;
pub mod latency;
mod log;
pub mod message;
mod mismatch;
pub mod pace;
pub mod place;
pub mod port;
pub mod process;
pub mod program;
pub mod random;
pub mod realtime;
pub mod service;
pub mod time;
pub mod topic;
pub mod wake;
