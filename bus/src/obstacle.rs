//! Obstacles to a flight: the set of all reasons against arming, as part of a message.

use std::fmt;

use crate::code::code;

code! {
    /// A reason against arming. Its code is the number of its bit in [`ArmingObstacles`].
    ArmingObstacle {
        /// Too few accepted poses in a row.
        NoPoses = 0 => "no poses, or too few good ones in a row",
        /// Position or attitude changed recently.
        Moving = 1 => "the vehicle moves, or is carried, or its poses are too noisy (by more than 15 mm or 2.9 deg)",
        /// The vehicle is not level.
        Tilted = 2 => "the vehicle is tilted (set it upright)",
        /// The vehicle is not at the height configured for the floor.
        OffFloor = 3 => "the vehicle is not on the floor (safety.arming-z-m)",
        /// The battery voltage is below the limit of the warning.
        BatteryLow = 4 => "the battery is low (safety.battery-low-v)",
        /// Neither plant nor bridge answers, or the vehicle behind the bridge does not.
        VehicleSilent = 5 => "the vehicle does not answer",
        /// Poses come from emulated cameras or a recording, and the vehicle is real.
        EmulatedPoses = 6 => "the poses are emulated and the vehicle is real (safety.allow-emulated-poses)",
        /// The vehicle is outside the soft border of the fence.
        OutsideFence = 7 => "the vehicle is outside the fence ([fence])",
        /// The trajectory from here leaves the soft border of the fence.
        PathOutsideFence = 8 => "the trajectory from here leaves the fence (move the vehicle, or change [trajectory] or [fence])",
        /// Processes of the instance run with different configurations.
        Configuration = 9 => "processes run with different configurations",
        /// An operator's stop is in force until the controller has commanded the motors off.
        Stopped = 10 => "an operator's stop is in force until the vehicle is disarmed",
        /// A pilot or the vehicle itself has control.
        ControlTaken = 11 => "a pilot or the vehicle itself has control",
        /// The vehicle's own estimate of its motion is not ready.
        EstimatorNotReady = 12 => "the vehicle's own estimate of its motion is not ready",
        /// A real vehicle is not known to act by itself soon enough if set-points end.
        NoTimeOut = 13 => "the vehicle's own time-out without set-points is unknown or too long (MAVLink and Betaflight: oqtal bridge setup; AscTec: bridge.vehicle-time-out-ms; limit: safety.vehicle-time-out-ms)",
        /// The daemon only observes.
        ObservesOnly = 14 => "the daemon only observes (safety.observe-only, mocap.replay)",
        /// The vehicle is locked until it is restarted.
        Locked = 15 => "the vehicle is locked: restart it",
        /// The bridge has not set the vehicle up yet.
        NotSetUp = 16 => "the bridge is still setting the vehicle up, which takes some seconds; if this stays, restart the vehicle",
        /// The stop sequence after the last flight is being sent.
        MotorsStopping = 17 => "the motors are being stopped after the last flight, which takes about a second",
        /// The vehicle reports running motors although none are commanded.
        MotorsRunning = 18 => "the motors of the vehicle run although none are commanded: do not approach it; unless somebody flies it by remote control, an operator's stop stops them",
    }
}

impl ArmingObstacle {
    /// All reasons, in order.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..u32::BITS as u8).filter_map(Self::from_code)
    }

    const fn bit(self) -> u32 {
        1 << self.code()
    }
}

/// A set of reasons against arming.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArmingObstacles(u32);

impl ArmingObstacles {
    /// Set received in a message; unknown bits are ignored.
    pub fn from_bits(bits: u32) -> Self {
        let known = ArmingObstacle::all().fold(0, |set, obstacle| set | obstacle.bit());
        Self(bits & known)
    }

    /// Representation in a message.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// The set, with `obstacle` added if `present`.
    pub fn with(self, obstacle: ArmingObstacle, present: bool) -> Self {
        if present { Self(self.0 | obstacle.bit()) } else { self }
    }

    /// Whether the set has `obstacle`.
    pub fn contains(self, obstacle: ArmingObstacle) -> bool {
        self.0 & obstacle.bit() != 0
    }

    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The reasons, in order.
    pub fn iter(self) -> impl Iterator<Item = ArmingObstacle> {
        ArmingObstacle::all().filter(move |obstacle| self.contains(*obstacle))
    }
}

impl fmt::Display for ArmingObstacles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, obstacle) in self.iter().enumerate() {
            write!(f, "{}{obstacle}", if index == 0 { "" } else { "; " })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_a_bit_and_words_of_its_own() {
        let all = ArmingObstacle::all()
            .fold(ArmingObstacles::default(), |set, obstacle| set.with(obstacle, true));
        assert_eq!(all.bits().count_ones() as usize, ArmingObstacle::all().count());
        assert_eq!(ArmingObstacles::from_bits(u32::MAX), all);
        assert!(all.iter().eq(ArmingObstacle::all()));
        let two = ArmingObstacles::default()
            .with(ArmingObstacle::Tilted, true)
            .with(ArmingObstacle::Moving, true)
            .with(ArmingObstacle::NoPoses, false);
        assert!(two.to_string().contains("2.9 deg); the vehicle is tilted"));
        assert!(ArmingObstacles::default().is_empty() && !two.is_empty());
    }
}
