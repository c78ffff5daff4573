//! Faults by hand (`[fault]`, `oqtal fly --fault`): decorators of a process's ports and of its turn.
//!
//! | file | subject |
//! |---|---|
//! | `clock.rs` | the instant from which the times of faults count, and the present instant |
//! | `transport.rs` | a transport whose readers inject the faults of `pose`, `command` and `vehicle` |
//! | `reader.rs` | the reading end of a topic with faults |
//! | `corrupt.rs` | messages made wrong |
//! | `turn.rs` | a turn that is woken when a delayed sample is due, and that may be slow |
//! | `radio.rs` | faults of the simulated radio |
//! | `outage.rs` | processes that do not act in virtual time |
//!
//! A process wires its ports through a [`FaultyTransport`] and its turn through [`FaultyTransport::turn`]. A fault of a topic acts
//! at its reading end: observers receive the messages as they were sent. Without faults a port passes everything through. Processes, lockstep and a
//! flight in one process run the same lines; the random numbers depend on seed, fault and sample alone. Faults that kill or stop
//! a process are injected by the process that started it, or in virtual time by the turn scheduler ([`outage`]).

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
