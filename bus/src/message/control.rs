//! Bodies of the control service.

use super::definition::{message, structure};
use super::field::{Field, Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::{Message, schema};

message! {
    /// Service `control`: an operator's request to the daemon.
    ControlRequestV1 = "oqtal.ControlRequest.v1" {
        /// [`crate::code::OperatorCommand`].
        command: u8 ["code"],
    }
}

message! {
    /// Service `control`: the daemon's answer.
    ControlResponseV1 = "oqtal.ControlResponse.v1" {
        /// [`crate::code::Answer`].
        answer: u8 ["code"],
        /// [`crate::code::Mode`] after the request.
        mode: u8 ["code"],
        /// [`crate::code::SafetyState`] after the request.
        state: u8 ["code"],
        /// [`crate::code::Cause`] of the state, or of the refusal.
        cause: u8 ["code"],
        /// [`crate::obstacle::ArmingObstacles`]: what keeps a flight from beginning.
        obstacles: u32 ["-"],
    }
}
