//! How the processes of oqtal meet: messages, topics, ports and wake-up, on iceoryx2.
// Two borrows in `wake.rs`: of a file descriptor, and of a word in shared memory.
#![deny(unsafe_code)]

pub mod bus;
pub mod code;
pub mod control;
pub mod error;
pub mod memory;
pub mod message;
mod mismatch;
pub mod paths;
pub mod port;
pub mod time;
pub mod topic;
pub mod transport;
pub mod wake;
