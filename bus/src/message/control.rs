//! Bodies of the control service.

use super::definition::{message, structure};
use super::field::{Field, Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::{Message, schema};
use crate::code::OperatorCommand;
use crate::time::Time;

message! {
    /// Service `control`: request of an operator to the daemon.
    ControlRequestV1 = "oqtal.ControlRequest.v1" {
        /// [`crate::code::OperatorCommand`].
        command: u8 ["code"],
        /// Instant until which a request that begins a flight may be executed, by the clock of the machine: the operator's
        /// time-out. [`Time::UNSET`] for no limit.
        valid_until: Time ["ns"],
        /// Hash of the configuration that a flight is to begin with; 0 for any.
        config_hash: u64 ["-"],
    }
}

impl ControlRequestV1 {
    /// A request without conditions.
    pub const fn of(command: OperatorCommand) -> Self {
        Self { command: command.code(), valid_until: Time::UNSET, config_hash: 0 }
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
        /// Hash of the daemon's configuration.
        config_hash: u64 ["-"],
        /// [`crate::obstacle::ArmingObstacles`]: conditions that prevent a flight.
        obstacles: u32 ["-"],
    }
}
