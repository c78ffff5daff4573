//! The bytes between oqtal and a vehicle, for both ends of the wire: the bridge is the host's end, an emulated vehicle the other.
//!
//! Pure: no I/O, no clock, no thread, and no allocation in encoding and decoding. A format has two layers:
//!
//! - *packet*: checked views on bytes. Length, type and checksum are looked at once, in `new_checked`; after that accessors
//!   give the fields as they are on the wire, in counts.
//! - *meaning*: SI units and radians, body axes x forward, y left, z up; what sources disagree on is configuration.
//!
//! A stream of bytes goes through a [`stream::Decoder`], which finds the frames in it whatever else it carries.
//!
//! | module | what |
//! |---|---|
//! | [`asctec`] | the serial interface of AscTec's X-3D-BL and Hummingbird |
//! | [`xbee`] | XBee radios: transparent, API mode 1, API mode 2 |
//! | [`link`] | how a link to a vehicle is written: `asctec:/dev/ttyUSB0,baud=57600,xbee=api2` |
//! | [`stream`] | frames out of any bytes, with bounded work |
#![forbid(unsafe_code)]

pub mod asctec;
pub mod link;
pub mod stream;
pub mod xbee;
