//! The first flight of a daemon, if one is planned when it starts: automatically (`safety.arm-at-start`), or by the command that
//! started it, such as `oqtal fly`.

/// State of the flight that is planned when the daemon starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FirstFlight {
    /// No flight is planned, or the plan was dropped: the previous daemon crashed, or the vehicle was replaced.
    #[default]
    None,
    /// The command that started the daemon will request a flight.
    Expected,
    /// An automatic flight begins as soon as poses allow it, if the vehicle is simulated.
    Pending,
    /// The flight has begun.
    Started,
    /// An operator called the flight off; a request of the starting command is refused until an operator arms.
    CalledOff,
    /// The automatic flight was refused: the vehicle is not simulated.
    Refused,
}

impl FirstFlight {
    /// The automatic flight that is about to begin, as text; `None` without one.
    pub(crate) fn pending_text(self) -> Option<&'static str> {
        (self == Self::Pending)
            .then_some("an automatic flight begins once poses and vehicle allow it")
    }
}
