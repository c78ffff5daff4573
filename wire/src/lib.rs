//! Wire formats between oqtal and a vehicle or a camera system, for both ends: the bridge and the receiver are clients, emulated
//! vehicles and cameras the other end.
//!
//! Pure: no I/O, clock or thread. A format has two layers:
//!
//! - *packet*: checked views of bytes. Length, type and checksum are checked once; accessors then return the fields as they are on
//!   the wire, in counts.
//! - *meaning*: SI units and radians, body axes x forward, y left, z up. Where sources disagree, the meaning is configured.
//!
//! The formats of vehicles do not allocate. A [`stream::Decoder`] finds their frames in a stream of bytes, whatever else the stream
//! carries. Those of camera systems come over reliable streams and in datagrams: their frames are decoded in place, what names the
//! bodies allocates, and every size is checked against the bytes that are there.
//!
//! | module | what |
//! |---|---|
//! | [`asctec`] | the serial interface of AscTec's X-3D-BL and Hummingbird |
//! | [`crazyflie_sitl`] | the Crazyflie's firmware as a program, and the simulator of its body |
//! | [`crtp`] | CRTP, the protocol of the Crazyflie |
//! | [`xbee`] | XBee radios: transparent, API mode 1, API mode 2 |
//! | [`mavlink`] | MAVLink 2, as PX4 and ArduPilot speak it |
//! | [`link`] | text forms of links: `asctec:/dev/ttyUSB0,baud=57600,xbee=api2` |
//! | [`stream`] | frames from arbitrary bytes, with bounded work |
//! | [`text`] | text of another machine, made fit for a log |
//! | `interpolation` | straight lines between the points of a table |
//! | `bytes` | numbers at places of a packet |
//! | [`motion`] | what a camera system measures: poses of bodies, positions of markers |
//! | [`qtm`] | the RT protocol of Qualisys Track Manager |
//! | [`vrpn`] | VRPN, as Vicon Tracker, Motive and others serve it |
//! | [`natnet`] | OptiTrack's NatNet |
#![forbid(unsafe_code)]

pub mod asctec;
mod bytes;
pub mod crazyflie_sitl;
pub mod crtp;
mod interpolation;
pub mod link;
pub mod mavlink;
pub mod motion;
pub mod natnet;
pub mod qtm;
pub mod stream;
pub mod text;
pub mod vrpn;
pub mod xbee;

pub use bytes::ByteOrder;
