//! Injected faults (`[fault]`, `oqtal fly --fault`): decorators of a process's ports and of its turn.
//!
//! | file | subject |
//! |---|---|
//! | `clock.rs` | time axis of faults: instant of arming, and present instant |
//! | `transport.rs` | a transport whose readers inject the faults of `pose`, `command` and `vehicle` |
//! | `reader.rs` | reader of a topic with faults |
//! | `corrupt.rs` | falsified messages |
//! | `turn.rs` | a turn that is woken for delayed samples, and that may be slow |
//! | `radio.rs` | faults of the simulated radio |
//! | `outage.rs` | processes that are stopped, killed or slow in virtual time |
//!
//! A process wires its ports through a [`FaultyTransport`] and its turn through [`FaultyTransport::turn`]. A fault of a topic
//! acts at the reader; observers receive the messages as sent. Without faults a port passes all messages unchanged. Separate
//! processes, lockstep and in-process flights execute the same code; the random numbers depend only on seed, fault and sample.
//! Faults that kill or stop a process are injected by the process that started it, or in virtual time by the turn scheduler
//! ([`outage`]).

mod clock;
mod corrupt;
pub mod outage;
mod radio;
mod reader;
mod transport;
mod turn;

pub use clock::{ArmingWatch, interval, is_within};
pub use radio::{RadioDisturbance, RadioFaults};
pub use reader::FaultyReader;
pub use transport::FaultyTransport;
pub use turn::FaultyTurn;
