//! Inter-process communication without the bus, for comparison: five mechanisms that transmit a message of the size of a pose.
//!
//! A message is stamped before it is sent and after it is received, at the rate of the chain. One process, [`super::camera`],
//! sends on all mechanisms and also feeds the chain; each receiver is a separate process with the daemon's settings.

mod iceoryx;
mod mechanism;
mod parcel;
mod process;
mod shared;
mod sockets;

pub use iceoryx::remove as remove_iceoryx2;
pub use mechanism::Mechanism;
pub use parcel::{Parcel, ParcelSender};
pub use process::{counter, directory, failed, open_sender, receive_all};
