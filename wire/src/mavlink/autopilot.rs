//! Autopilots and the mode in which they follow set-points.

use std::fmt;

use crate::link::AutopilotKind;

/// Family of an autopilot, from its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotFirmware {
    /// PX4 or ArduPilot.
    Known(AutopilotKind),
    /// An autopilot that is not supported.
    Unknown,
    /// No autopilot: a ground station, a camera, this computer.
    None,
}

impl AutopilotFirmware {
    /// Numbers of the families, MAV_AUTOPILOT; that of [`AutopilotFirmware::Unknown`] is MAV_AUTOPILOT_GENERIC.
    const CODES: [(u8, Self); 4] = [
        (0, Self::Unknown),
        (3, Self::Known(AutopilotKind::ArduPilot)),
        (8, Self::None),
        (12, Self::Known(AutopilotKind::Px4)),
    ];

    /// MAV_AUTOPILOT of this family \[-\].
    pub(super) fn code(self) -> u8 {
        let known = Self::CODES.into_iter().find(|(_, firmware)| *firmware == self);
        known.map_or(0, |(code, _)| code)
    }

    /// Family of a MAV_AUTOPILOT.
    pub(super) fn from_code(code: u8) -> Self {
        let known = Self::CODES.into_iter().find(|(number, _)| *number == code);
        known.map_or(Self::Unknown, |(_, firmware)| firmware)
    }
}

impl fmt::Display for AutopilotFirmware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Known(AutopilotKind::Px4) => "PX4",
            Self::Known(AutopilotKind::ArduPilot) => "ArduPilot",
            Self::Unknown => "an autopilot that is not supported",
            Self::None => "no autopilot",
        })
    }
}

/// Modes of ArduCopter: numbers of `custom_mode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArduPilotMode(pub u32);

impl ArduPilotMode {
    /// Attitude or body rates by set-point; needs no position.
    pub const GUIDED_NO_GPS: Self = Self(20);
    /// Angles by the pilot's sticks: the mode after the start.
    pub const STABILIZE: Self = Self(0);
}

/// Modes of PX4: `custom_mode` holds the main mode in its third byte, and the sub-mode in its fourth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Px4Mode(pub u32);

impl Px4Mode {
    /// Set-points from outside.
    pub const OFFBOARD: Self = Self::main(6);
    /// Position by the pilot's sticks.
    pub const POSITION: Self = Self::main(3);

    /// Mode of this main mode.
    pub const fn main(number: u8) -> Self {
        Self((number as u32) << 16)
    }

    /// Number of the main mode \[-\].
    pub const fn main_number(self) -> u8 {
        (self.0 >> 16) as u8
    }
}

impl AutopilotKind {
    /// The `custom_mode` in which this autopilot follows set-points \[-\].
    pub fn setpoint_mode(self) -> u32 {
        match self {
            Self::Px4 => Px4Mode::OFFBOARD.0,
            Self::ArduPilot => ArduPilotMode::GUIDED_NO_GPS.0,
        }
    }

    /// Mode number in the command that selects this mode \[-\].
    pub fn setpoint_mode_command(self) -> u32 {
        match self {
            Self::Px4 => u32::from(Px4Mode::OFFBOARD.main_number()),
            Self::ArduPilot => ArduPilotMode::GUIDED_NO_GPS.0,
        }
    }

    /// Whether `custom_mode` is the mode in which this autopilot follows set-points.
    pub fn follows_setpoints(self, custom_mode: u32) -> bool {
        match self {
            Self::Px4 => Px4Mode(custom_mode).main_number() == Px4Mode::OFFBOARD.main_number(),
            Self::ArduPilot => custom_mode == ArduPilotMode::GUIDED_NO_GPS.0,
        }
    }

    /// Whether integer parameters are sent as the integer's bits in the field of the real number.
    pub fn sends_integers_as_bits(self) -> bool {
        self == Self::Px4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_point_modes_have_the_measured_numbers() {
        assert_eq!(AutopilotKind::Px4.setpoint_mode(), 0x60000);
        assert_eq!(AutopilotKind::ArduPilot.setpoint_mode(), 20);
        assert!(!AutopilotKind::Px4.follows_setpoints(0x30000));
    }
}
