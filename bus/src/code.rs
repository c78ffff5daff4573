//! Enumerations in messages: one byte each; a byte from another process may be invalid.

use std::fmt;

macro_rules! code {
    ($(#[$meta:meta])* $name:ident { $($(#[$variant_meta:meta])* $variant:ident = $number:literal => $text:literal,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u8)]
        pub enum $name { $($(#[$variant_meta])* $variant = $number,)* }

        impl $name {
            /// Representation in a message.
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// The value of a byte; `None` for an invalid byte.
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

pub(crate) use code;

mod cause;

pub use cause::Cause;

code! {
    /// Interpretation of the numbers of a command.
    Actuation {
        /// Motors off, regardless of the numbers.
        Disarmed = 0 => "disarmed",
        /// Attitude sticks and collective thrust, Eq. (61).
        Sticks = 1 => "sticks",
        /// Torque and collective thrust.
        Torque = 2 => "torque",
        /// Attitude and collective thrust, for a vehicle with its own attitude loop.
        Attitude = 3 => "attitude",
    }
}

code! {
    /// Activity of the daemon.
    Mode {
        /// Motors off; waits for an operator's request.
        Disarmed = 0 => "disarmed",
        /// A flight is requested; waits until poses are accepted and the vehicle answers.
        Waiting = 1 => "waiting",
        /// Flies the mission.
        Flying = 2 => "flying",
        /// Descends at the present position.
        Landing = 3 => "landing",
        /// Computes commands from the poses and sends only "disarmed".
        Observing = 4 => "observing",
    }
}

impl Mode {
    /// Whether motors are commanded to run.
    pub fn commands_motors(self) -> bool {
        matches!(self, Self::Flying | Self::Landing)
    }

    /// Whether a mission is active, flown or only observed.
    pub fn is_armed(self) -> bool {
        self.commands_motors() || self == Self::Observing
    }
}

code! {
    /// Safety state, ordered by increasing severity.
    SafetyState {
        /// Poses are fresh and plausible, and the vehicle answers.
        Nominal = 0 => "Nominal",
        /// A condition is worse than it should be; the flight continues.
        Degraded = 1 => "Degraded",
        /// In flight: the vehicle is flown on the predicted motion, then the last command is held, until poses return. On the
        /// ground: no take-off until poses and vehicle are available.
        Coast = 2 => "Coast",
        /// The vehicle holds its position; the mission waits.
        Hold = 3 => "Hold",
        /// The vehicle lands at its present position.
        Land = 4 => "Land",
        /// Without poses, a vehicle with its own attitude loop stays level and sinks, for a limited time.
        Descend = 5 => "Descend",
        /// Motors off until an operator arms again.
        Stop = 6 => "Stop",
    }
}

impl SafetyState {
    /// Whether the daemon ends the flight in this state.
    pub fn ends_flight(self) -> bool {
        self >= Self::Land
    }
}

code! {
    /// Reason for which a law's command is not flown, and the fallback law's is.
    #[derive(Default)]
    HandoverCause {
        /// The command is flown.
        #[default]
        None = 0 => "",
        /// The external law is connected and did not answer within its budget.
        Missing = 1 => "no answer in time",
        /// A number of the command is not finite.
        NotFinite = 2 => "not finite",
        /// The command exceeds the vehicle's range.
        OutOfRange = 3 => "out of range",
        /// The answer is to a question that was not asked.
        OtherQuestion = 4 => "answer to another question",
        /// The command leads to a greater tilt than `envelope.tilt-deg`.
        Tilt = 5 => "leads to too much tilt",
        /// The command leads to a greater body rate than `envelope.rate-rad-s`.
        Rate = 6 => "leads to too high a rate",
        /// The command leads to a greater speed than `envelope.speed-m-s`.
        Speed = 7 => "leads to too high a speed",
        /// The command leads so close to the fence that the vehicle could not be stopped before it.
        Fence = 8 => "leads to the fence",
        /// The command leads so close to the floor that the descent could not be stopped before it.
        Floor = 9 => "leads to the floor",
        /// The last packet of the law had a wrong length or magic.
        Malformed = 10 => "answer with a wrong length or magic",
        /// No external law is connected.
        Absent = 11 => "no law is connected",
        /// The external law closed its connection or raised an exception in this tick.
        Ended = 12 => "the law ended",
        /// The vehicle is commanded by attitude, and all four numbers of the quaternion are zero.
        NoAttitude = 13 => "no attitude",
        /// The command leads to a heading far from that of the reference, from which a fallback could not level the vehicle.
        Heading = 14 => "leads to a heading far from the reference",
    }
}

code! {
    /// Holder of control over a vehicle.
    ControlHolder {
        /// Nobody: the motors are off, or the vehicle does not report the holder.
        Nobody = 0 => "nobody",
        /// The bridge: the vehicle follows its set-points.
        Bridge = 1 => "the bridge",
        /// A pilot, another ground station, or the vehicle's own failsafe: no set-points are sent.
        Another = 2 => "a pilot or the vehicle itself",
    }
}

code! {
    /// Link to a vehicle.
    VehicleLink {
        /// The vehicle does not answer, or its bridge has not been ready for a flight since the port was opened.
        Silent = 0 => "silent",
        /// The vehicle answers, and reports the state of its motors.
        Answers = 1 => "answers",
        /// The vehicle answers, and does not report the state of its motors: they may run, started by another host.
        MotorsUnknown = 2 => "answers, motors unknown",
    }
}

code! {
    /// Reason for which a vehicle did not execute a request.
    VehicleRefusal {
        /// No refusal since the motors last ran.
        None = 0 => "",
        /// The vehicle refused to run its motors: its pre-arm checks fail.
        Arming = 1 => "the vehicle refuses to arm",
        /// The vehicle refused to stop its motors.
        Disarming = 2 => "the vehicle refuses to disarm",
        /// The vehicle refused the mode in which it follows set-points.
        Mode = 3 => "the vehicle refuses the mode for set-points",
        /// A command of the start sequence was not answered.
        NoAnswer = 4 => "the vehicle does not answer commands",
        /// The autopilot is of another kind than configured in the link.
        OtherAutopilot = 5 => "the autopilot is of another kind than the link configures",
        /// Only vehicles of another system id than configured in the link answer.
        OtherSystem = 6 => "a vehicle of another system id answers",
        /// The vehicle is locked until it is restarted.
        Locked = 7 => "the vehicle is locked until it is restarted",
        /// The vehicle uses a protocol version that the bridge does not support.
        OtherVersion = 8 => "the vehicle uses another protocol version",
        /// Packets of the vehicle are not signed with the configured key, and are ignored.
        Unsigned = 9 => "the vehicle does not sign with the key of bridge.mavlink.signing-key-file",
        /// The bridge has not yet read or set all that a flight needs.
        NotSetUp = 10 => "the bridge is still setting the vehicle up",
    }
}

code! {
    /// State of a vehicle's own estimator.
    EstimatorState {
        /// The vehicle does not report it.
        Unknown = 0 => "unknown",
        /// The estimator has no valid position.
        NotReady = 1 => "not ready",
        /// The estimator has attitude and position.
        Ready = 2 => "ready",
    }
}

code! {
    /// Request of an operator.
    OperatorCommand {
        /// Report mode and safety state.
        Status = 0 => "status",
        /// Arm and fly the mission at once, or refuse.
        Arm = 1 => "arm",
        /// Arm and fly the mission as soon as poses are accepted and the vehicle answers.
        Fly = 2 => "fly",
        /// Land at the present position.
        Land = 3 => "land",
        /// Motors off on the ground.
        Disarm = 4 => "disarm",
        /// Motors off now, latched.
        Stop = 5 => "stop",
        /// Give control back to the configured law, after the fallback law took over.
        Resume = 20 => "resume",
        /// Fly to a point and stay there.
        Goto = 6 => "goto",
        /// Fly another trajectory from the present point.
        Trajectory = 7 => "fly",
        /// Come to rest and stay.
        Hover = 8 => "hover",
        /// Change settings.
        Set = 9 => "set",
        /// Report a setting.
        Get = 10 => "get",
        /// Take the last change of settings back.
        Undo = 11 => "undo",
        /// Change the settings that differ in a file.
        Reload = 12 => "reload",
    }
}

impl OperatorCommand {
    /// Whether motors may start because of a request: it must not be executed late, or under another configuration than expected.
    pub const fn begins_flight(self) -> bool {
        matches!(self, Self::Arm | Self::Fly)
    }

    /// Whether a request has no effect unless a flight is under way or about to begin.
    pub const fn needs_flight(self) -> bool {
        matches!(self, Self::Land | Self::Resume | Self::Goto | Self::Trajectory | Self::Hover)
    }

    /// Whether a request ends a flight, and calls off one that was requested before.
    pub const fn ends_flight(self) -> bool {
        matches!(self, Self::Land | Self::Disarm | Self::Stop)
    }

    /// Whether a request changes a flight or its settings beyond arming, landing and stop.
    pub const fn changes_flight(self) -> bool {
        matches!(
            self,
            Self::Goto | Self::Trajectory | Self::Hover | Self::Set | Self::Undo | Self::Reload
        )
    }
}

code! {
    /// Kind of a reference.
    ReferenceKind {
        /// Position with its derivatives, and yaw with its rate.
        Position = 1 => "position",
        /// Attitude and body rate, and the height.
        Attitude = 2 => "attitude",
    }
}

code! {
    /// Answer of the daemon.
    Answer {
        /// Done.
        Done = 0 => "done",
        /// Accepted; takes effect with the next tick.
        Accepted = 1 => "accepted",
        /// Refused, with a cause.
        Refused = 2 => "refused",
    }
}

code! {
    /// Kind of a record of the daemon's inputs.
    InputKind {
        /// The daemon started.
        Start = 0 => "start",
        /// A turn of the loop.
        Turn = 1 => "turn",
        /// A request of an operator, executed at the end of the previous turn.
        Request = 2 => "request",
        /// A loss of files of the instance, which took effect at the end of the previous turn.
        FilesLost = 3 => "files lost",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_bytes_decode_to_their_codes_and_others_to_none() {
        for code in 0..=u8::MAX {
            if let Some(cause) = Cause::from_code(code) {
                assert_eq!(cause.code(), code);
            }
        }
        assert_eq!(SafetyState::from_code(7), None);
        assert!(SafetyState::Stop > SafetyState::Coast);
    }
}
