//! How the processes of oqtal meet: messages, topics, ports, time, latency, configuration, the process shell.
// Two borrows in `wake.rs`: of a file descriptor, and of a word in shared memory.
#![deny(unsafe_code)]

pub mod bus;
pub mod code;
pub mod conductor;
pub mod config;
pub mod control;
pub mod error;
pub mod latency;
pub mod message;
pub mod pace;
pub mod place;
pub mod port;
pub mod process;
pub mod random;
pub mod realtime;
pub mod time;
pub mod topic;
pub mod wake;
