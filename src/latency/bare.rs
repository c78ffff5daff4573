//! Inter-process communication without the bus, for comparison: five mechanisms that carry a message of the size of a pose.
//!
//! A message is stamped before it is sent and after it is received, at the rate of the chain. One process, [`super::camera`],
//! sends on all mechanisms and also feeds the chain; each receiving end is a process of its own with the daemon's settings.

mod eventfd;
mod futex;
mod iceoryx;
mod mechanism;
mod parcel;
mod process;
mod shared;
mod udp_socket;
mod unix_datagram;

pub use iceoryx::beside;
pub use mechanism::Mechanism;
pub use parcel::{Parcel, ParcelSender};
pub use process::{counter, directory, open_sender, receiver_job};
