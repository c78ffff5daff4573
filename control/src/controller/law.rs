//! The interface of an attitude law, and that of its options.

use crate::options::OptionError;
use crate::tracking_error::{AttitudeReference, AttitudeState};

use super::input::InputForm;

/// A law that turns the body to its reference.
///
/// For any argument, a law commands something finite and within the vehicle's range, and no argument spoils a later command.
pub trait AttitudeLaw {
    /// The vehicle's command: [`Torque`](crate::quantity::Torque) or [`StickCommand`](crate::quantity::StickCommand). The
    /// default is zero torque or centred sticks.
    type Command: Default;

    /// Returns the command for a body at `state` that should be at `reference`, `dt_s` after the last call \[s\]. If any
    /// argument is not finite, returns the default command and leaves the law unchanged.
    fn update(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Self::Command {
        if state.is_finite() && reference.is_finite() && dt_s.is_finite() {
            self.command(state, reference, dt_s)
        } else {
            Self::Command::default()
        }
    }

    /// The law itself: [`update`](Self::update) for finite arguments.
    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Self::Command;

    /// Sets integral action to zero and discards the gain, which is computed again in the next step. Counters are kept.
    fn reset(&mut self);

    /// Sets the lag of the rate that the feed-forward inverts \[s\], for a loop that runs every `period_s` \[s\]; gains stay. A law
    /// without feed-forward has nothing to set.
    fn set_rate_lag(&mut self, _lag_s: f64, _period_s: f64) {}

    /// Number of Riccati equations solved so far, the first and failed ones included \[-\].
    fn riccati_solves(&self) -> u32 {
        0
    }

    /// Number of Riccati equations without a usable solution so far \[-\]; the law then keeps its last gain.
    fn failed_solves(&self) -> u32 {
        0
    }
}

/// The options of an attitude law: gains for both vehicles, rules, and the law built from them.
///
/// With this trait and a line in the table of `controller/mod.rs` a law is registered: see `docs/your-own-law.md`. The default
/// is for the Hummingbird in rate form.
pub trait LawOptions: Copy + Default {
    /// The law.
    type Law<I: InputForm>: AttitudeLaw<Command = I::Command>;

    /// The gains that `oqtal tune` searches. The first one is raised by the study of the greatest gain.
    const TUNED: &'static [SearchRange];

    /// Whether the law flies within the estimation, prediction and position law of [`crate::predictive`] by itself.
    const IS_PREDICTIVE: bool = false;

    /// Gains for the paper's spacecraft in torque form.
    #[must_use]
    fn spacecraft() -> Self;

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    fn check(&self) -> Result<(), OptionError>;

    /// The law for a vehicle commanded through `input`, in a loop with the period `period_s` \[s\].
    ///
    /// # Errors
    /// The first option whose value is not allowed, or options for which there is no gain.
    fn build<I: InputForm>(self, input: I, period_s: f64) -> Result<Self::Law<I>, OptionError>;
}

/// A gain, by its key in the configuration, and the range in which it is tuned, evenly in its logarithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchRange {
    /// Dotted key in the whole configuration: `control.pid.gain`.
    pub key: &'static str,
    /// Lower bound, above 0 \[unit of the gain\].
    pub low: f64,
    /// Upper bound \[unit of the gain\].
    pub high: f64,
}

impl SearchRange {
    /// The range from `low` to `high` of the gain `key`.
    #[must_use]
    pub const fn new(key: &'static str, low: f64, high: f64) -> Self {
        Self { key, low, high }
    }
}
