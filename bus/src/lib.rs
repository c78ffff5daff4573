//! How the processes of oqtal meet: messages, topics, ports, time, latency, configuration, the process shell.
#![forbid(unsafe_code)]

pub mod code;
pub mod conductor;
pub mod config;
pub mod latency;
pub mod message;
pub mod pace;
pub mod port;
pub mod process;
pub mod random;
pub mod time;
pub mod topic;
