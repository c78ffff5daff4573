//! Interface of an attitude law, its terms, and the ranges in which its gains are tuned.

use std::borrow::Cow;

use nalgebra::Vector3;

use crate::tracking_error::{AttitudeReference, AttitudeState};

/// A law that turns the body to its reference.
///
/// For any argument the command is finite and within the vehicle's range, and no argument affects a later command. No step
/// allocates. Implementations are `Copy`: the cache warm-up executes a copy of the law.
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

    /// Computes the command; [`update`](Self::update) calls it for finite arguments.
    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Self::Command;

    /// Sets integral action to zero and discards the gain, which is computed again in the next step. Counters are kept.
    fn reset(&mut self);

    /// Records that the input `u` \[N m, body axes, in rate form -1..1\] of another law was sent in place of that of the last step:
    /// integral action returns to its state before the step, and an incremental law continues from `u`.
    fn yield_to(&mut self, _u: &Vector3<f64>) {}

    /// Terms of the last command; zero before the first one, and for a law that does not store them.
    fn terms(&self) -> LawTerms {
        LawTerms::default()
    }

    /// Sets the lag of the rate that the feed-forward inverts \[s\], for a loop that runs every `period_s` \[s\]; gains are
    /// unchanged. Without effect on a law without feed-forward.
    fn set_rate_lag(&mut self, _lag_s: f64, _period_s: f64) {}

    /// Number of Riccati equations solved so far, including the first and failed ones \[-\].
    fn riccati_solves(&self) -> u32 {
        0
    }

    /// Number of Riccati equations without a usable solution so far \[-\]; the law then keeps its last gain.
    fn failed_solves(&self) -> u32 {
        0
    }
}

/// Terms of the last computed input `u`, before the vehicle's limits \[N m, body axes, in rate form -1..1\]. Their sum is that
/// input; a term that the law does not have is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LawTerms {
    /// Feedback of the errors of attitude and rate \[as the sum\].
    pub proportional: Vector3<f64>,
    /// Integral action, or the past input to which an incremental law adds \[as the sum\].
    pub integral: Vector3<f64>,
    /// Motion of the reference and gyroscopic torque \[as the sum\].
    pub feed_forward: Vector3<f64>,
    /// Compensation of the estimated disturbance \[as the sum\].
    pub disturbance: Vector3<f64>,
}

impl LawTerms {
    /// The terms of `u`: feedback is `u` minus integral action and feed-forward; zero if a number is not finite.
    pub fn of(u: &Vector3<f64>, integral: Vector3<f64>, feed_forward: Vector3<f64>) -> Self {
        let proportional = u - integral - feed_forward;
        if !proportional.iter().all(|number| number.is_finite()) {
            return Self::default();
        }
        Self { proportional, integral, feed_forward, disturbance: Vector3::zeros() }
    }
}

/// Key of a gain in the configuration, and its tuning range, uniform in the logarithm.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchRange {
    /// Key of the gain in its section: `gain`, or `pid.gain` in the section `[control]`.
    pub key: Cow<'static, str>,
    /// Lower bound, above 0 \[unit of the gain\].
    pub low: f64,
    /// Upper bound \[unit of the gain\].
    pub high: f64,
}

impl SearchRange {
    /// The range from `low` to `high` of the gain `key`.
    pub const fn new(key: &'static str, low: f64, high: f64) -> Self {
        Self { key: Cow::Borrowed(key), low, high }
    }

    /// The same range with the key prefixed by `section` and a dot.
    pub fn within(&self, section: &str) -> Self {
        Self { key: Cow::Owned(format!("{section}.{}", self.key)), ..*self }
    }
}
