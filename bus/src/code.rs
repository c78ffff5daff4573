//! Enumerations as they travel in messages: one byte each, decoded with doubt.

use std::fmt;

macro_rules! code {
    ($(#[$meta:meta])* $name:ident { $($(#[$variant_meta:meta])* $variant:ident = $number:literal => $text:literal,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$variant_meta])* $variant = $number,)* }

        impl $name {
            /// The byte that travels.
            #[must_use]
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// The value behind a byte; `None` if no version of ours sends it.
            #[must_use]
            pub const fn from_code(code: u8) -> Option<Self> {
                match code {
                    $($number => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(match self { $(Self::$variant => $text,)* })
            }
        }
    };
}

code! {
    /// What the numbers of a command mean.
    Actuation {
        /// Motors off, whatever the numbers.
        Disarmed = 0 => "disarmed",
        /// Attitude sticks and collective thrust, Eq. (61).
        Sticks = 1 => "sticks",
        /// Torque and collective thrust.
        Torque = 2 => "torque",
    }
}

code! {
    /// What the daemon is doing.
    Mode {
        /// Motors off; waits for an operator.
        Disarmed = 0 => "disarmed",
        /// Asked to fly; waits until poses can be believed and the vehicle answers.
        Waiting = 1 => "waiting",
        /// Flies its mission.
        Flying = 2 => "flying",
        /// Descends where it is.
        Landing = 3 => "landing",
    }
}

code! {
    /// How far the daemon trusts what it flies on; ordered, the worst last.
    SafetyState {
        /// Poses are fresh and plausible, and the vehicle answers.
        Nominal = 0 => "Nominal",
        /// In flight: flies on on the last command and waits for poses to come back. On the ground: waits for poses, or for
        /// the vehicle, and does not take off.
        Coast = 1 => "Coast",
        /// Motors off until an operator arms again.
        Stop = 2 => "Stop",
    }
}

code! {
    /// Why the daemon does not trust what it flies on, or refuses a request.
    Cause {
        /// All is well.
        None = 0 => "",
        /// No pose arrived in time.
        NoPose = 1 => "no pose",
        /// Poses arrive, but too old.
        Stale = 2 => "stale pose",
        /// A pose is not finite.
        NotFinite = 3 => "pose not finite",
        /// The cameras lost the body.
        Untracked = 4 => "body not tracked",
        /// The quaternion is not of unit norm.
        NotUnit = 5 => "quaternion not of unit norm",
        /// Sequence or capture time went back or stood still.
        Order = 6 => "pose out of order",
        /// The pose jumped further than the vehicle can fly.
        Jump = 7 => "pose jumped",
        /// The same pose came again under new sequence numbers.
        Frozen = 8 => "pose frozen",
        /// An operator asked for it.
        Operator = 9 => "operator",
        /// Not possible in the present mode.
        WrongMode = 10 => "not possible in this mode",
        /// Neither plant nor bridge answers, or the vehicle behind the bridge does not, or its motors stopped in flight or never
        /// started, or another vehicle took its place.
        NoVehicle = 11 => "vehicle silent",
    }
}

code! {
    /// What an operator can ask.
    OperatorCommand {
        /// Say how you are.
        Status = 0 => "status",
        /// Arm and fly the mission, now or not at all.
        Arm = 1 => "arm",
        /// Arm and fly the mission as soon as poses can be believed and the vehicle answers.
        Fly = 2 => "fly",
        /// Land where you are.
        Land = 3 => "land",
        /// Motors off on the ground.
        Disarm = 4 => "disarm",
        /// Motors off now, latched.
        Stop = 5 => "stop",
    }
}

code! {
    /// What the daemon answers.
    Answer {
        /// Done.
        Done = 0 => "done",
        /// Taken; takes effect with the next tick.
        Accepted = 1 => "accepted",
        /// Refused, with a cause.
        Refused = 2 => "refused",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive_the_journey_and_strangers_do_not() {
        for code in 0..=u8::MAX {
            if let Some(cause) = Cause::from_code(code) {
                assert_eq!(cause.code(), code);
            }
        }
        assert_eq!(SafetyState::from_code(3), None);
        assert!(SafetyState::Stop > SafetyState::Coast);
    }
}
