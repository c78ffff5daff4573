//! CRTP, the protocol of the Crazyflie: packets of one header byte and up to 30 bytes, little endian, over a Crazyradio or, with firmware
//! in the loop, one packet per datagram.
//!
//! | port, channel | host to vehicle | vehicle to host |
//! |---|---|---|
//! | 0, 0 | | text of its console |
//! | 2, 0 and 5, 0 | table of contents of parameters and of log variables: size and CRC (3), element (2, id u16) | the same: count u16, CRC u32; id u16, type, group, name |
//! | 2, 1 and 2, 2 | reads (id u16) and writes (id u16, value) a parameter | id u16, result u8, value; id u16, value |
//! | 3, 0 | set-point: roll, pitch, yaw (f32, degrees or deg/s), thrust (u16, 0..60000) | |
//! | 4, 0 | number of memories (1) | the same |
//! | 5, 1 | log blocks: reset (5), create (6), start (3) | command, block, result |
//! | 5, 2 | | log data: block, milliseconds (u24), values |
//! | 6, 1 | external pose (8), of several vehicles (9); before protocol 12 emergency stop (3) and its keep-alive (4) | |
//! | 7, 0 and 7, 1 | stop (0); end of the set-points (0, u32 ms) | |
//! | 9, 0 and 9, 1 | from protocol 12 on, state (0x0C); arm (1), recover (2), emergency stop (3), its keep-alive (4) | the same with bit 7 set |
//! | 13, 0 and 13, 1 | before protocol 12, arm (1), recover (2); protocol version (0) | the same |
//! | 15, 0 and 15, 1 | echo; source | the same bytes; `Bitcraze Crazyflie` |
//!
//! Signs and units of the wire are those of [`LegacySetpoint`] and [`Supervision`]; everything else in this crate is in radians and
//! axes x forward, y left, z up.
//!
//! Sources: bitcraze/crazyflie-firmware (ports, layouts, signs, time limits), cflib 0.1.34, which agrees byte for byte.
//!
//! No method allocates, and no input makes one panic.

mod logging;
mod packet;
mod pose;
mod quaternion;
mod reply;
mod request;
mod setpoint;
mod supervision;
mod table;
mod thrust;
mod value;

pub use logging::{LogBlock, LogFields, MAX_LOG_VARIABLES};
pub use packet::{CrtpError, CrtpPacket, CrtpPort, MAX_CRTP_PACKET, MAX_CRTP_PAYLOAD};
pub use pose::{CrtpPose, PackedPose, PackedPoses};
pub use quaternion::{compress, decompress};
pub use reply::{CrtpReply, LogCommand, SupervisorAnswer};
pub use request::CrtpRequest;
pub use setpoint::{LegacySetpoint, MAX_CRTP_THRUST};
pub use supervision::{SUPERVISOR_PROTOCOL, Supervision, SupervisorCommand};
pub use table::{TableElement, TableInfo, TableKind};
pub use thrust::CrtpThrustCurve;
pub use value::{CrtpValue, LogType, ParameterType};
