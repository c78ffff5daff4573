//! Poses over the network, in the protocols of real camera systems: QTM, VRPN, NatNet.
//!
//! | file | subject |
//! |---|---|
//! | `spec.rs` | protocols to serve, as text |
//! | `opening.rs` | servers from their options |
//! | `model.rs` | names and markers of the bodies |
//! | `feed.rs` | bounded queue from the loop to the network thread |
//! | `network.rs` | the network thread |
//! | `trouble.rs` | frames that the network loses, repeats or reorders |
//! | `server.rs` | interface of the protocol servers |
//! | `address.rs` | sockets at the addresses of a server |
//! | `clients.rs` | the loop of clients over TCP, for every protocol |
//! | `qtm_server.rs`, `vrpn_server.rs`, `natnet_server.rs` | sessions and frames of each protocol |
//! | `source.rs` | pose source that also serves its poses |
//! | `script.rs` | motion shown by the command `serve` |
//! | `program.rs` | the command `serve`: a camera system alone |
//!
//! No call blocks: sockets are non-blocking, a client that does not read is disconnected once its queue is full, and each step
//! reads a bounded number of bytes and requests per client.

mod address;
mod clients;
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

pub use opening::open;
pub use program::ServeArgs;
pub use source::{ServeTurn, ServedPoses};
pub use spec::ServeSpec;
