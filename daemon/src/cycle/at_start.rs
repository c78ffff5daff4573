//! The flight that the daemon begins without an operator, `safety.arm-at-start`.

/// State of the automatic flight at start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AtStart {
    /// No automatic flight is configured, or it was cancelled.
    #[default]
    Nothing,
    /// The flight begins as soon as poses allow it, if the vehicle is simulated.
    Awaited,
    /// The flight has begun.
    Taken,
    /// Refused: the vehicle is not simulated.
    Refused,
}
