//! Wie's quaternion PID, with limits on the slew rate and the input. Paper, Section II.E.
//!
//! ```text
//! u = -sat_U(J {2 k sat_L(eps + 1/T integral of eps) + c omega})        Eq. (17), corrected
//! ```

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::feedback::RateFeedback;
use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use crate::integral::Integral;
use crate::options::{OptionError, Rule, check_options};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Options of [`QuaternionPid`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PidOptions {
    /// `k` \[1/s^2, in rate form 1/s\].
    pub gain: f64,
    /// `T` \[s\]; infinite for no integral action.
    pub integral_time_s: f64,
    /// `c` \[1/s\]; without effect in rate form.
    pub rate_gain_per_s: f64,
    /// Rate that `c` multiplies; without effect in rate form.
    pub rate: RateFeedback,
    /// `omega_max`: greatest slew rate about each axis \[rad/s\]; infinite for no limit.
    pub max_rate_rad_s: f64,
    /// `a`: deceleration with which the slew rate is brought to zero at the target \[rad/s^2\]; infinite for no
    /// limit.
    pub max_acceleration_rad_s2: f64,
    /// Limit of each component of the integral of `eps` \[s\].
    pub integral_limit_s: f64,
    /// Whether the motion of the reference is fed forward. Not in the paper.
    pub feed_forward: bool,
}

impl Default for PidOptions {
    fn default() -> Self {
        Self {
            // Not in the paper, which gives no gains for its quadrotor.
            gain: 8.0,
            integral_time_s: 2.0,
            // In the paper: Table IV. Nullified in rate form.
            rate_gain_per_s: 50.0,
            rate: RateFeedback::Omega,
            // Not in the paper, which gives no values.
            max_rate_rad_s: f64::INFINITY,
            max_acceleration_rad_s2: f64::INFINITY,
            // Not in the paper.
            integral_limit_s: 0.5,
            feed_forward: false,
        }
    }
}

impl PidOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] =
        &[SearchRange::new("gain", 1.0, 40.0), SearchRange::new("integral-time-s", 0.2, 50.0)];

    /// Gains for the paper's spacecraft in torque form: Table IV.
    pub fn spacecraft() -> Self {
        Self { gain: 5.95, integral_time_s: 1.15, rate_gain_per_s: 50.0, ..Self::default() }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("gain", self.gain, Rule::Positive),
            ("integral-time-s", self.integral_time_s, Rule::PositiveOrInfinite),
            ("rate-gain-per-s", self.rate_gain_per_s, Rule::Positive),
            ("max-rate-rad-s", self.max_rate_rad_s, Rule::PositiveOrInfinite),
            ("max-acceleration-rad-s2", self.max_acceleration_rad_s2, Rule::PositiveOrInfinite),
            ("integral-limit-s", self.integral_limit_s, Rule::NotNegative),
        ])
    }
}

/// The PID for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuaternionPid<I> {
    options: PidOptions,
    input: I,
    eps_i: Integral,
    terms: LawTerms,
}

impl<I: InputForm> QuaternionPid<I> {
    /// Takes over the integral action of `old`, which flew until now.
    pub(super) fn adopt(&mut self, old: &Self) {
        self.eps_i.adopt(&old.eps_i);
    }

    /// The law with these options.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: PidOptions, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let eps_i = Integral::new(options.integral_limit_s);
        Ok(Self { options, input, eps_i, terms: LawTerms::default() })
    }

    /// `sat_L`: `pi` limited to the slew rate allowed at this `eps`.
    fn slew_limited(&self, pi: &Vector3<f64>, eps: &Vector3<f64>) -> Vector3<f64> {
        // In rate form the demand is itself the slew rate.
        let c = self.input.inertia().map_or(1.0, |_| self.options.rate_gain_per_s);
        let k = self.options.gain;
        let (omega_max, a) = (self.options.max_rate_rad_s, self.options.max_acceleration_rad_s2);
        // Eq. (18), erratum E-18. `min` passes over NaN: infinity times zero means no limit.
        let limit = eps.map(|eps_i| c / (2.0 * k) * (4.0 * a * eps_i.abs()).sqrt().min(omega_max));
        pi.zip_map(&limit, |pi_i, limit_i| pi_i.clamp(-limit_i, limit_i))
    }
}

impl<I: InputForm> AttitudeLaw for QuaternionPid<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let (k, t) = (self.options.gain, self.options.integral_time_s);
        // In rate form `c omega` is nullified (Section VII.C).
        let c = self.input.inertia().map_or(0.0, |_| self.options.rate_gain_per_s);
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let (eps, omega_e) = (error.eps(), error.rate_error(state.rate, reference.rate));
        let omega = match self.options.rate {
            RateFeedback::Omega => state.rate.0,
            RateFeedback::OmegaE => omega_e,
        };
        let feed_forward = if self.options.feed_forward {
            self.input.feed_forward(&error, &omega_e, reference)
        } else {
            Vector3::zeros()
        };

        let pi = eps + self.eps_i.value() / t;
        // Eq. (17), erratum E-17
        let u = |pi: Vector3<f64>| feed_forward - self.input.input_for(&(2.0 * k * pi + c * omega));
        let limited = u(self.slew_limited(&pi, eps));
        let integral = -self.input.input_for(&(2.0 * k / t * self.eps_i.value()));
        self.terms = LawTerms::of(&limited, integral, feed_forward);
        // Eq. (19), erratum E-19
        let given = self.input.saturate(&limited);

        let push = -self.input.input_for(eps);
        self.eps_i.step(eps, &push, &(u(pi) - given), dt_s);
        I::command_from(given)
    }

    fn reset(&mut self) {
        self.eps_i.reset();
    }

    fn yield_to(&mut self, _u: &Vector3<f64>) {
        self.eps_i.undo();
    }

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }
}
