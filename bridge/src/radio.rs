//! Crazyradio as a port: USB transfers block, so a separate thread exchanges packets with the vehicles.
//!
//! | file | subject |
//! |---|---|
//! | `schedule.rs` | whose packet goes next; nothing old; packets per second of each vehicle |
//! | `dongle.rs` | interface to a radio: one packet out, its acknowledgement back |
//! | `usb.rs` | a Crazyradio on USB |
//! | `worker.rs` | the exchange of packets, and the account of it |
//! | `port.rs` | one vehicle's port, for the bridge |
//! | `share.rs` | one radio for several bridges, over UDP |

mod dongle;
mod port;
mod schedule;
mod share;
mod usb;
mod worker;

pub use dongle::{RadioAck, RadioDongle};
pub use port::RadioPortOptions;
pub use schedule::RadioCounts;
pub use share::{RadioShareOptions, SharedVehicle, share_radio};
pub use worker::RadioWorker;
