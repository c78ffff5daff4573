//! Communication between the processes of oqtal: messages, topics, ports and wake-up, on iceoryx2.
// Mapping of shared memory in `shared.rs`.
#![deny(unsafe_code)]

pub mod bus;
pub mod code;
pub mod control;
pub mod error;
mod membership;
pub mod memory;
pub mod message;
mod mismatch;
mod node;
pub mod obstacle;
pub mod origin;
pub mod paths;
pub mod port;
mod ports;
mod private;
mod remains;
pub mod shared;
pub mod stop;
pub mod suspend;
pub mod text;
pub mod time;
pub mod topic;
pub mod transport;
pub mod wake;
