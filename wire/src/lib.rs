//! Wire formats between oqtal and a vehicle or a camera system, for both ends: the bridge and the receiver on one side, emulated vehicles
//! and cameras on the other.
//!
//! Pure: no I/O, clock or thread. A format has two layers:
//!
//! - *packet*: checked views of bytes. Length, type and checksum are checked once; accessors then return the fields
//!   in the units of the wire.
//! - *meaning*: SI units and radians, body axes x forward, y left, z up. Where sources disagree, the meaning is configured.
//!
//! The formats of vehicles do not allocate. A [`stream::Decoder`] finds their frames in a stream of bytes,
//! among other data. The formats of camera systems use reliable streams and datagrams: frames are decoded in place, names of bodies
//! allocate, and every size is checked against the received bytes.
//!
//! | module | subject |
//! |---|---|
//! | [`asctec`] | the serial interface of AscTec's X-3D-BL and Hummingbird |
//! | [`betaflight_sitl`] | Betaflight as a program, and the simulator of its body |
//! | [`crazyflie_sitl`] | the Crazyflie's firmware as a program, and the simulator of its body |
//! | [`crtp`] | CRTP, the protocol of the Crazyflie |
//! | [`xbee`] | XBee radios: transparent, API mode 1, API mode 2 |
//! | [`mavlink`] | MAVLink 2, for PX4 and ArduPilot |
//! | [`msp`] | MSP, of Betaflight |
//! | [`link`] | text forms of links: `asctec:/dev/ttyUSB0,baud=57600,xbee=api2` |
//! | [`stream`] | frames from arbitrary bytes, with bounded work |
//! | [`hex`] | bytes as hexadecimal digits |
//! | [`text`] | text of another machine, escaped for a log |
//! | `thrust` | from a share of the greatest thrust to the thrust of a set-point |
//! | `interpolation` | straight lines between the points of a table |
//! | `bytes` | numbers in packets; bytes without allocation |
//! | [`motion`] | measurements of a camera system: poses of bodies, positions of markers |
//! | [`qtm`] | the RT protocol of Qualisys Track Manager |
//! | [`vrpn`] | VRPN, of Vicon Tracker, Motive and others |
//! | [`natnet`] | OptiTrack's NatNet |
#![forbid(unsafe_code)]

pub mod asctec;
pub mod betaflight_sitl;
mod bytes;
pub mod crazyflie_sitl;
pub mod crtp;
pub mod hex;
mod interpolation;
pub mod link;
pub mod mavlink;
pub mod motion;
pub mod msp;
pub mod natnet;
pub mod qtm;
pub mod stream;
pub mod text;
mod thrust;
pub mod vrpn;
pub mod xbee;

pub use bytes::{ByteArray, ByteOrder};
pub use thrust::{InvalidThrustCurve, ThrustCurve};
