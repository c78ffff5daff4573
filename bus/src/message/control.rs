//! Bodies of the control service.

use super::definition::{message, structure};
use super::field::{Field, Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::{Message, schema};
use crate::code::{Answer, Cause, OperatorCommand};
use crate::obstacle::{ArmingObstacle, ArmingObstacles};
use crate::origin::Origin;
use crate::text::{LongText, ShortText};
use crate::time::Time;

/// User of a request that came over UDP: its sender is not known as a process of this host, and [`ControlRequestV1::program`] names its
/// address.
pub const NO_USER: u32 = u32::MAX;

/// Text of a request to arm that is refused if settings were changed since the daemon started.
pub const AS_STARTED: &str = "as started";
/// First line of the answer to a request of settings that sets the present values again.
pub const UNCHANGED: &str = "nothing changes, these are the present values:";

message! {
    /// Service `control`: request of an operator to the daemon.
    ControlRequestV1 = "oqtal.ControlRequest.v1" {
        /// [`crate::code::OperatorCommand`].
        command: u8 ["code"],
        /// Instant until which a request that begins a flight may be executed, by the clock of the machine: the operator's
        /// time-out. [`Time::UNSET`] for no limit.
        valid_until: Time ["ns"],
        /// Instant at which the request was made, by the clock of the machine: one that begins a flight is refused after a later stop,
        /// landing or disarming. [`Time::UNSET`] for an unknown one.
        asked_at: Time ["ns"],
        /// 1 if the operator repeats the request while only the end of the last flight prevents it.
        repeated: u8 ["flag"],
        /// Hash of the configuration that a flight is to begin with; 0 for any.
        config_hash: u64 ["-"],
        /// Process that makes the request, as [`Origin::bits`].
        process: u64 ["-"],
        /// User of that process, as the process states it: the files of the instance admit its owner and root only. [`NO_USER`] for none.
        user: u32 ["-"],
        /// Name of that process.
        program: ShortText ["text"],
        /// Point of a goto.
        point: [f64; 3] ["m, world"],
        /// 3-2-1 yaw of a goto; NaN for the present one.
        yaw: f64 ["rad, world"],
        /// Settings `KEY=VALUE`, one per line; a key; the name of a trajectory; the path of a file; [`AS_STARTED`].
        text: LongText ["text"],
    }
}

impl ControlRequestV1 {
    /// A request without conditions, of an unnamed author.
    pub const fn of(command: OperatorCommand) -> Self {
        Self {
            command: command.code(),
            valid_until: Time::UNSET,
            asked_at: Time::UNSET,
            repeated: 0,
            config_hash: 0,
            process: 0,
            user: 0,
            program: ShortText::EMPTY,
            point: [0.0; 3],
            yaw: f64::NAN,
            text: LongText::EMPTY,
        }
    }

    /// This request, made under the name `program`: by the calling process, now and as its present user, if it was not signed before.
    pub fn by(self, program: &str) -> Self {
        let signed = Self { program: ShortText::new(program), ..self };
        if self.asked_at.is_set() {
            return signed;
        }
        let (process, user) = (Origin::own().bits(), rustix::process::getuid().as_raw());
        Self { asked_at: Time::now(), process, user, ..signed }
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
        /// Reason of a refusal, or the requested value; empty for none.
        text: LongText ["text"],
    }
}

impl ControlResponseV1 {
    /// Whether the only obstacle to the requested flight is a vehicle that is not at rest, for example after a flight; the request is then
    /// repeated until the vehicle is at rest.
    pub fn comes_to_rest(&self) -> bool {
        use ArmingObstacle::{Moving, Stopped, Tilted};
        let obstacles = ArmingObstacles::from_bits(self.obstacles);
        self.answer == Answer::Refused.code()
            && !Cause::from_code(self.cause).is_some_and(Cause::prevents_execution)
            && obstacles.iter().any(|obstacle| obstacle != Tilted)
            && obstacles.iter().all(|obstacle| matches!(obstacle, Moving | Stopped | Tilted))
    }
}

message! {
    /// Topic `event`: a request to the daemon that changes a flight or its settings. A request that the loop refuses has a second
    /// message with the same number.
    EventV1 = "oqtal.Event.v1" {
        /// Instant at which the request was made, or else received, by the clock of the machine.
        time: Time ["ns"],
        /// Number of the request among those of this daemon, from 1; [`super::InputV1`] names it.
        number: u64 ["-"],
        /// [`crate::code::OperatorCommand`].
        command: u8 ["code"],
        /// [`crate::code::Answer`].
        answer: u8 ["code"],
        /// [`crate::code::Cause`] of a refusal.
        cause: u8 ["code"],
        /// Author of the request, as in [`ControlRequestV1`].
        process: u64 ["-"],
        /// User of that process; [`NO_USER`] for none.
        user: u32 ["-"],
        /// Name of that process.
        program: ShortText ["text"],
        /// Point of a goto.
        point: [f64; 3] ["m, world"],
        /// 3-2-1 yaw of a goto; NaN for the present one.
        yaw: f64 ["rad, world"],
        /// Text of the request; for a file, the settings that it changes.
        text: LongText ["text"],
        /// Reason of a refusal.
        reason: LongText ["text"],
    }
}

impl EventV1 {
    /// Author of the request as text: program, process and user, or an address.
    pub fn author(&self) -> String {
        let (program, process) = (self.program.as_str(), Origin::from_bits(self.process).process());
        match self.user {
            NO_USER => format!("{program} over UDP"),
            user => format!("{program}, process {process} of user {user}"),
        }
    }

    /// Cause and reason of a refusal as text; `None` for a request that was not refused.
    pub fn refusal(&self) -> Option<String> {
        let is_refused = self.answer == Answer::Refused.code();
        let cause = Cause::from_code(self.cause).filter(|_| is_refused)?;
        Some(match self.reason.is_empty() {
            true => format!("refused, {cause}"),
            false => format!("refused, {cause}: {}", self.reason),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signed_request_keeps_its_author() {
        // As of root, before its process became another user.
        let user = u32::MAX;
        let signed =
            ControlRequestV1 { user, ..ControlRequestV1::of(OperatorCommand::Arm).by("a") };
        let again = signed.by("b");
        assert_eq!((again.user, again.asked_at), (user, signed.asked_at));
        assert_eq!(again.program.as_str(), "b");
    }
}
