//! Poses over the network, in the protocols of real camera systems: QTM, VRPN, NatNet.
//!
//! | file | subject |
//! |---|---|
//! | `spec.rs` | what is served, as text |
//! | `model.rs` | names and markers of the bodies |
//! | `feed.rs` | bounded queue from the loop to the network thread |
//! | `network.rs` | the network thread |
//! | `trouble.rs` | frames that the network loses, repeats or reorders |
//! | `qtm_server.rs`, `vrpn_server.rs`, `natnet_server.rs` | the sockets of each protocol |
//! | `connection.rs` | a client's connection, whose queue is bounded |
//! | `source.rs` | poses of a process, served as they are delivered |
//! | `script.rs` | what the command `serve` shows |
//! | `program.rs` | the command `serve`: a camera system alone |
//!
//! Nothing blocks: sockets are non-blocking, a client that does not read is cut off once its queue is full, and every step reads a
//! bounded number of bytes and requests of each client.

mod address;
mod connection;
mod feed;
mod model;
mod natnet_server;
mod network;
mod opening;
mod program;
mod qtm_server;
mod script;
mod server;
mod source;
mod spec;
mod trouble;
mod vrpn_server;

pub use feed::{FrameFeed, ServedFrame};
pub use model::MAX_BODIES;
pub use network::{NetworkThread, ServeCounters};
pub use opening::open;
pub use program::ServeArgs;
pub use server::{Endpoint, FrameServer};
pub use source::{ServeTurn, ServedPoses};
pub use spec::{InvalidServeSpec, ServeSpec};
