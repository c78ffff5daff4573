//! The flight that the daemon begins without an operator, `safety.arm-at-start`.

/// State of the automatic flight at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AutoTakeoff {
    /// No automatic flight is configured, or it was cancelled.
    #[default]
    None,
    /// The flight begins as soon as poses allow it, if the vehicle is simulated.
    Pending,
    /// The flight has begun.
    Started,
    /// Refused: the vehicle is not simulated.
    Refused,
}
