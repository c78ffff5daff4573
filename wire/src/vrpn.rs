//! VRPN, the Virtual Reality Peripheral Network: trackers over TCP, as Vicon Tracker, Motive and others serve them.
//!
//! | connection | how |
//! |---|---|
//! | direct | the client connects to TCP port 3883 |
//! | called back | the client sends the datagram `IP PORT` and a NUL to UDP port 3883, and the server connects to that address |
//!
//! Both ends send a cookie of 24 bytes, `vrpn: ver. 07.38  0`; the major version must agree. Then messages follow, big endian: length
//! without padding (u32), time (u32 s, u32 us), sender (i32), type (i32), sequence number (u32), payload, padding to 8 bytes. Each end
//! numbers its senders and types and describes them by messages of the types -1 and -2 before it uses them.
//!
//! A pose is a message of the type `vrpn_Tracker Pos_Quat`: sensor (i32), padding (i32), position (3 f64, m), quaternion (4 f64, x y z
//! w). Messages of a client go back by the types `vrpn_Base ping_message` and `vrpn_Base pong_message`.
//!
//! [`VrpnClient`] and [`VrpnSession`] are the two ends of a connection: bytes in, poses and bytes out, no I/O.
//!
//! Source: the client and server of vrpn/vrpn, version 07.38.

mod callback;
mod client;
mod cookie;
mod message;
mod names;
mod session;
mod tracker;

pub use callback::CallbackRequest;
pub use client::{VrpnClient, VrpnClientError, VrpnEvent};
pub use cookie::{COOKIE_BYTES, CookieError, VrpnVersion};
pub use message::{MAX_MESSAGE_BYTES, VrpnMessage, VrpnMessageError, VrpnStream, write_message};
pub use session::{NotVrpn, VrpnSession};
pub use tracker::TrackerPose;

/// Port of a server, TCP and UDP \[-\].
pub const VRPN_PORT: u16 = 3883;
/// Type of poses.
pub const POSE_TYPE: &str = "vrpn_Tracker Pos_Quat";
/// Type of messages that ask whether a server is alive.
pub const PING_TYPE: &str = "vrpn_Base ping_message";
/// Type of the answers to pings.
pub const PONG_TYPE: &str = "vrpn_Base pong_message";
