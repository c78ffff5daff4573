//! OptiTrack's NatNet, versions 3.0 to 4.4, of Motive.
//!
//! | address | use |
//! |---|---|
//! | UDP 1510 | requests of clients and their answers; frames to unicast clients come from another port of the server |
//! | UDP 1511 on 239.255.42.99 | frames by multicast |
//!
//! A message is its number (u16), the length of its content (u16) and the content, little endian. A client sends *connect* and gets
//! the *server info*: versions, rate of the server's clock, address of the frames; it sends *request model definitions* and gets the
//! names and numbers of the bodies. A unicast client sends *keep alive* about once a second, and gets the frames at the address from
//! which it does.
//!
//! Lengths are metres, quaternions x y z w. Which axis points up is a setting of the server: Motive's default is Y.
//!
//! [`NatNetClient`] and [`NatNetServer`] are the two ends: datagrams in, frames and datagrams out, no I/O.
//!
//! Sources: NatNet SDK 4.1, its sample clients and their description of the packets.

mod client;
mod frame;
mod frame_writing;
mod message;
mod model;
mod model_reading;
mod server;
mod server_info;

pub use client::{NatNetClient, NatNetClientError, NatNetEvent, NatNetStage};
pub use frame::{NatNetBody, NatNetFrame, NatNetTimes};
pub use message::{MessageId, NatNetError, NatNetMessage, NatNetVersion};
pub use model::{BodyDefinition, ModelDefinitions};
pub use server::{NatNetServer, NatNetServerOptions};
pub use server_info::ServerInfo;

use std::net::Ipv4Addr;

/// Port of requests \[-\].
pub const COMMAND_PORT: u16 = 1510;
/// Port of frames by multicast \[-\].
pub const DATA_PORT: u16 = 1511;
/// Group of frames by multicast.
pub const MULTICAST_GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 42, 99);
