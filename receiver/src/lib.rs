//! The receiver process: poses of a real camera system, in place of the emulated one.
//!
//! | file | subject |
//! |---|---|
//! | `process.rs` | from the configuration to the loop |
//! | `command.rs` | the command line |
//! | `turn.rs` | one turn over its ports: read the sockets, publish poses |
//! | `receiver.rs` | from frames to published poses, pure |
//! | `gate.rs` | numbers and dates frames, pure |
//! | `clock.rs` | the clock of a camera server against this machine's |
//! | `transform.rs` | axes of cameras to those of world and body |
//! | `routes.rs` | routes of bodies |
//! | `stream.rs` | interface of a connection that delivers frames |
//! | `qtm.rs` | Qualisys Track Manager |
//! | `natnet.rs` | OptiTrack Motive |
//! | `vrpn.rs` | VRPN |
//! | `socket.rs` | sockets that do not block |
//! | `connect.rs` | opening a connection |
//! | `attempt.rs` | the outcome of an attempt to connect |
//! | `definitions.rs` | definitions of bodies that arrive between frames |
//! | `background.rs` | the background thread: log, definitions, reconnection |
//! | `note.rs` | events for the log |
//! | `watch.rs` | changes since the last call, for the log |
//! | `discover.rs` | search for camera systems in the network |
//! | `probe.rs` | `oqtal receiver probe`: whether cameras are fit to fly with |
#![forbid(unsafe_code)]

mod attempt;
mod background;
pub mod clock;
mod command;
mod connect;
mod definitions;
mod discover;
pub mod gate;
mod natnet;
mod note;
mod probe;
mod process;
mod qtm;
mod receiver;
mod routes;
mod socket;
mod stream;
mod transform;
mod turn;
mod vrpn;
mod watch;

pub use attempt::ConnectError;
pub use command::{ReceiverArgs, ReceiverCommand};
pub use connect::connect_to_all;
pub use process::{ReceiverParts, check, open, run};
pub use receiver::PoseReceiver;
pub use stream::{CameraStream, FrameSink, MeasuredBody};
