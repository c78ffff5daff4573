//! Communication between the processes of oqtal: messages, topics, ports and wake-up, on iceoryx2.
//!
//! | file | subject |
//! |---|---|
//! | `topic.rs` | every topic of the system |
//! | `message.rs` | the messages, plain data in SI units |
//! | `code.rs` | enumerations in messages |
//! | `obstacle.rs` | obstacles to a flight |
//! | `text.rs` | short text in a message |
//! | `origin.rs` | the process that wrote a message |
//! | `time.rs` | instants and spans of time |
//! | `transport.rs` | interface of the ports of topics |
//! | `bus.rs` | the instance between processes: joining, opening ports, leaving |
//! | `memory.rs` | topics inside one process, for virtual time |
//! | `port.rs` | typed writers and readers |
//! | `ports.rs` | ports of iceoryx2, as bytes |
//! | `node.rs` | a node of iceoryx2, which opens services and ports |
//! | `control.rs` | requests of operators and their answers |
//! | `stop.rs` | the operator's stop, in shared memory and by signal |
//! | `obeying.rs` | processes that obey operators, found in /proc |
//! | `lease.rs` | the lease of the port to a vehicle to another process |
//! | `wake.rs` | wake-up of sleeping processes |
//! | `shared.rs` | words in a mapped file |
//! | `atomic.rs` | atomic words, replaced in a model of all interleavings |
//! | `membership.rs` | the processes of an instance |
//! | `member_files.rs` | the files by whose locks it is joined |
//! | `paths.rs` | directories and names of an instance |
//! | `private.rs` | the part of shared memory that is inaccessible to other users |
//! | `remains.rs` | files left behind by dead processes |
//! | `watch.rs` | files of a living instance that were removed |
//! | `suspend.rs` | suspension of the machine |
//! | `error.rs` | errors of the bus |
//! | `mismatch.rs` | kinds of errors when a service is opened |
// Mapping of shared memory in `shared.rs`, and the guard of its mappings.
#![deny(unsafe_code)]

mod atomic;
pub mod bus;
pub mod code;
pub mod control;
pub mod error;
pub mod lease;
mod member_files;
mod membership;
pub mod memory;
pub mod message;
mod mismatch;
mod node;
pub mod obeying;
pub mod obstacle;
pub mod origin;
pub mod paths;
pub mod port;
mod ports;
mod private;
pub mod remains;
pub mod shared;
pub mod stop;
pub mod suspend;
pub mod text;
pub mod time;
pub mod topic;
pub mod transport;
pub mod wake;
pub mod watch;
