//! Commands that an autopilot acknowledges, COMMAND_LONG.

use super::address::MavlinkAddress;

/// Value of the second parameter of an arming command that skips the vehicle's own checks \[-\].
pub(super) const FORCE: f32 = 21_196.0;

/// Command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandKind {
    /// MAV_CMD_DO_SET_MODE.
    SetMode {
        /// Number of the mode: of ArduPilot its `custom_mode`, of PX4 its main mode \[-\].
        mode: u32,
        /// Number of PX4's sub-mode; 0 for none \[-\].
        sub_mode: u32,
    },
    /// MAV_CMD_COMPONENT_ARM_DISARM.
    Arm {
        /// Whether the motors shall run.
        run: bool,
        /// Whether the vehicle's own checks are skipped.
        is_forced: bool,
    },
    /// MAV_CMD_SET_MESSAGE_INTERVAL.
    MessageInterval {
        /// Number of the message \[-\].
        message: u32,
        /// Time between two \[us\].
        interval_us: u32,
    },
    /// MAV_CMD_REQUEST_MESSAGE: one message, immediately.
    RequestMessage {
        /// Number of the message \[-\].
        message: u32,
    },
    /// MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN of the autopilot.
    Reboot,
}

/// Command to a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleCommandLong {
    /// The vehicle.
    pub target: MavlinkAddress,
    /// The command.
    pub kind: CommandKind,
    /// Number of this transmission, from 0 \[-\].
    pub confirmation: u8,
}

impl CommandKind {
    /// MAV_CMD_DO_SET_MODE.
    pub const SET_MODE: u16 = 176;
    /// MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN.
    pub const REBOOT: u16 = 246;
    /// MAV_CMD_COMPONENT_ARM_DISARM.
    pub const ARM: u16 = 400;
    /// MAV_CMD_SET_MESSAGE_INTERVAL.
    pub const MESSAGE_INTERVAL: u16 = 511;
    /// MAV_CMD_REQUEST_MESSAGE.
    pub const REQUEST_MESSAGE: u16 = 512;

    /// Number of the command \[-\].
    pub fn number(&self) -> u16 {
        match self {
            Self::SetMode { .. } => Self::SET_MODE,
            Self::Arm { .. } => Self::ARM,
            Self::MessageInterval { .. } => Self::MESSAGE_INTERVAL,
            Self::RequestMessage { .. } => Self::REQUEST_MESSAGE,
            Self::Reboot => Self::REBOOT,
        }
    }
}

/// Result of a command, MAV_RESULT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AckResult {
    /// The command was executed.
    Accepted,
    /// The command cannot be executed now.
    TemporarilyRejected,
    /// The parameters of the command are wrong.
    Denied,
    /// The command is unknown.
    Unsupported,
    /// The command failed.
    Failed,
    /// The command is being executed: another result follows.
    InProgress,
    /// Anything else.
    OtherResult,
}

impl AckResult {
    /// Numbers of the results, MAV_RESULT.
    const CODES: [(u8, Self); 6] = [
        (0, Self::Accepted),
        (1, Self::TemporarilyRejected),
        (2, Self::Denied),
        (3, Self::Unsupported),
        (4, Self::Failed),
        (5, Self::InProgress),
    ];

    /// MAV_RESULT of this result; that of a failure for [`AckResult::OtherResult`] \[-\].
    pub(super) fn code(self) -> u8 {
        let known = Self::CODES.into_iter().find(|(_, result)| *result == self);
        known.map_or(4, |(code, _)| code)
    }

    /// Result of a MAV_RESULT.
    pub(super) fn from_code(code: u8) -> Self {
        let known = Self::CODES.into_iter().find(|(number, _)| *number == code);
        known.map_or(Self::OtherResult, |(_, result)| result)
    }
}
