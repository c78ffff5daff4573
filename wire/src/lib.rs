//! Wire formats between oqtal and a vehicle, for both ends: the bridge is the host, an emulated vehicle the other end.
//!
//! Pure: no I/O, clock or thread, and no allocation in encoding and decoding. A format has two layers:
//!
//! - *packet*: checked views of bytes. `new_checked` checks length, type and checksum once; accessors then return the fields as
//!   they are on the wire, in counts.
//! - *meaning*: SI units and radians, body axes x forward, y left, z up. Where sources disagree, the meaning is configured.
//!
//! A [`stream::Decoder`] finds the frames in a stream of bytes, whatever else the stream carries.
//!
//! | module | what |
//! |---|---|
//! | [`asctec`] | the serial interface of AscTec's X-3D-BL and Hummingbird |
//! | [`xbee`] | XBee radios: transparent, API mode 1, API mode 2 |
//! | [`link`] | text form of a link to a vehicle: `asctec:/dev/ttyUSB0,baud=57600,xbee=api2` |
//! | [`stream`] | frames from arbitrary bytes, with bounded work |
#![forbid(unsafe_code)]

pub mod asctec;
pub mod link;
pub mod stream;
pub mod xbee;
