//! Commands that an autopilot acknowledges, COMMAND_LONG.

use super::address::MavlinkAddress;

/// Value of the second parameter of an arming command by which it is executed whatever the vehicle's checks say \[-\].
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
        /// Whether the motors are to run.
        run: bool,
        /// Whether the vehicle's own checks are passed over.
        is_forced: bool,
    },
    /// MAV_CMD_SET_MESSAGE_INTERVAL.
    MessageInterval {
        /// Number of the message \[-\].
        message: u32,
        /// Time between two \[us\].
        interval_us: u32,
    },
    /// MAV_CMD_REQUEST_MESSAGE: once, at once.
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
    /// Number of the command \[-\].
    #[must_use]
    pub fn number(&self) -> u16 {
        match self {
            Self::SetMode { .. } => 176,
            Self::Arm { .. } => 400,
            Self::MessageInterval { .. } => 511,
            Self::RequestMessage { .. } => 512,
            Self::Reboot => 246,
        }
    }
}

/// Result of a command, MAV_RESULT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AckResult {
    /// Executed.
    Accepted,
    /// Cannot be executed now.
    TemporarilyRejected,
    /// Its parameters are wrong.
    Denied,
    /// Unknown.
    Unsupported,
    /// Failed.
    Failed,
    /// Being executed: another result follows.
    InProgress,
    /// Anything else.
    OtherResult,
}
