//! MAVLink 2, for either end of a link: packets, and the meaning of the messages that are used, in SI units and our axes.
//!
//! | file | subject |
//! |---|---|
//! | `packet.rs` | packets: encoder, grammar of the stream |
//! | `crc_extra.rs` | checksum seeds of the messages (generated) |
//! | `payload.rs` | bytes of packets; payloads: ids of the messages, fields |
//! | `signature.rs` | signatures of packets, and their check |
//! | `address.rs` | systems and their components |
//! | `content.rs` | meaning of the messages that are understood |
//! | `read.rs`, `write.rs` | from payloads to meanings, and back |
//! | `axes.rs` | our axes and those of MAVLink: the only place where they meet |
//! | `command.rs` | commands that are acknowledged |
//! | `autopilot.rs` | modes of PX4 and of ArduCopter |
//! | `parameter.rs` | parameters of autopilots |
//!
//! Set-points are SET_ATTITUDE_TARGET alone: body rates and thrust (type mask 128), or attitude, yaw rate and thrust (type mask 3).
//! ArduCopter answers any other mask, and a quaternion that is not of unit length, by leaving rate control without a message.

mod address;
mod autopilot;
mod axes;
mod command;
mod content;
mod crc_extra;
mod packet;
mod parameter;
mod payload;
mod read;
mod signature;
mod write;

pub use address::MavlinkAddress;
pub use autopilot::{ArduPilotMode, AutopilotFirmware, Px4Mode};
pub use axes::{attitude_axes, vector_axes};
pub use command::{AckResult, CommandKind, VehicleCommandLong};
pub use content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, MavlinkTruth, SetpointKind, TextSeverity, Timesync,
};
pub use packet::{MavlinkDecoder, MavlinkEncoder, MavlinkGrammar, MavlinkPacket};
pub use parameter::{ParameterName, ParameterValue};
pub use payload::{MAX_PACKET, MavlinkWire};
pub use signature::{SignatureCheck, SignedBytes, SigningKey};
