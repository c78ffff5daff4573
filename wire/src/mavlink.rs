//! MAVLink 2, for either end of a link: what messages mean, in SI units and our axes. Their bytes and checksums are the crate
//! `mavlink`'s.
//!
//! | file | subject |
//! |---|---|
//! | `packet.rs` | packets: encoder, grammar of the stream |
//! | `signature.rs` | signatures of packets, and their check |
//! | `address.rs` | systems and their components |
//! | `content.rs` | the messages that are understood, and their meaning |
//! | `read.rs`, `write.rs` | from messages of the crate to meanings, and back |
//! | `axes.rs` | our axes and those of MAVLink: the only place where they meet |
//! | `origin.rs` | the place on earth of the world |
//! | `command.rs` | commands that are acknowledged |
//! | `autopilot.rs` | modes of PX4 and of ArduCopter |
//! | `parameter.rs` | parameters of autopilots |
//! | `thrust.rs` | from the share of greatest thrust to MAVLink's thrust |
//!
//! Set-points are SET_ATTITUDE_TARGET alone: body rates and thrust (type mask 128), or attitude, yaw rate and thrust (type mask 3).
//! ArduCopter answers any other mask, and a quaternion that is not of unit length, by leaving rate control without a word.

mod address;
mod autopilot;
mod axes;
mod command;
mod content;
mod origin;
mod packet;
mod parameter;
mod read;
mod signature;
mod thrust;
mod write;

pub use address::MavlinkAddress;
pub use autopilot::{ArduPilotMode, AutopilotFirmware, Px4Mode};
pub use axes::{attitude_axes, vector_axes};
pub use command::{AckResult, CommandKind, VehicleCommandLong};
pub use content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, MavlinkTruth, SetpointKind, TextSeverity, Timesync,
};
pub use packet::{
    MAX_PACKET, MavlinkDecoder, MavlinkEncoder, MavlinkGrammar, MavlinkPacket, MavlinkWire,
};
pub use parameter::{ParameterName, ParameterValue};
pub use signature::{SignatureCheck, SignedBytes, SigningKey};
pub use thrust::{InvalidThrustCurve, ThrustCurve};
