//! The first flight of a daemon, if it is known at the start: by `safety.arm-at-start`, or since the command that started the
//! daemon requests it.

/// State of the flight at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AutoTakeoff {
    /// No flight is known at the start, or the last daemon did not end in good order.
    #[default]
    None,
    /// The command that started the daemon will request a flight.
    Expected,
    /// The flight begins as soon as poses allow it, if the vehicle is simulated.
    Pending,
    /// The flight has begun.
    Started,
    /// An operator called the flight off before it began: it is refused until an operator arms.
    CalledOff,
    /// Refused: the vehicle is not simulated.
    Refused,
}
