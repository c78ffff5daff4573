//! Incremental nonlinear dynamic inversion: corrects the last input by the remaining error of the angular acceleration. Not in
//! the paper.
//!
//! ```text
//! u = u_f + B^-1 (nu - omega_dot_f - A (omega - omega_f))
//! nu = c (C omega_d - 2 k eps - omega) + C omega_d_dot - omega_e x C omega_d
//! ```
//!
//! Source: E. J. J. Smeur, Q. P. Chu and G. C. H. E. de Croon, *Adaptive Incremental Nonlinear Dynamic Inversion for Attitude
//! Control of Micro Air Vehicles*, JGCD 39(3), 2016, without its adaptation of `B`. The model is `omega_dot = A omega + B u + d`
//! with an unknown `d`, which cancels between now and the filtered past (index `f`, one filter for the measured motion and the
//! input). By torque `A = 0` and `B = J^-1`, as in the source. With rate input, `A` and `B` are those of the vehicle's own rate
//! loop with its lag, and the law is a rate loop around it; if the rate follows at once, the increments are of the rate itself:
//! `u = u_f + K^-1 (omega_sp - omega_f)`.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::filtered_rate::FilteredRate;
use super::input::{InputForm, RateModel};
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use crate::options::{OptionError, Rule, check_options};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Maximum delay of the input before its filter \[ticks\].
const MOST_TICKS: usize = 8;

/// Options of [`Indi`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct IndiOptions {
    /// `k`, the gain from attitude to rate \[1/s\].
    pub attitude_gain_per_s: f64,
    /// `c`, the gain from rate to angular acceleration \[1/s\].
    pub rate_gain_per_s: f64,
    /// Cut-off frequency of the filter of rate and input \[Hz\].
    pub cutoff_hz: f64,
    /// Number of ticks from a command to the pose that shows its effect \[-\]: the input is delayed by this number before its
    /// filter, so that it is compared with the motion that it caused. 0 with the prediction of `oqtal-dt`.
    pub input_delay_ticks: usize,
    /// Whether the reference's motion is fed forward.
    pub feed_forward: bool,
}

impl Default for IndiOptions {
    fn default() -> Self {
        Self {
            attitude_gain_per_s: 4.0,
            rate_gain_per_s: 16.0,
            cutoff_hz: 1.0,
            input_delay_ticks: 2,
            feed_forward: true,
        }
    }
}

impl IndiOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-gain-per-s", 0.5, 40.0),
        SearchRange::new("rate-gain-per-s", 2.0, 60.0),
        SearchRange::new("cutoff-hz", 0.02, 10.0),
    ];

    /// Gains for the paper's spacecraft in torque form.
    pub fn spacecraft() -> Self {
        Self { input_delay_ticks: 0, ..Self::default() }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-gain-per-s", self.attitude_gain_per_s, Rule::Positive),
            ("rate-gain-per-s", self.rate_gain_per_s, Rule::Positive),
            ("cutoff-hz", self.cutoff_hz, Rule::Between(1e-3, 1000.0)),
            (
                "input-delay-ticks",
                self.input_delay_ticks as f64,
                Rule::Between(0.0, MOST_TICKS as f64),
            ),
        ])
    }
}

/// `(A, B^-1)` of the rate model `omega_dot = A omega + B u + d`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct InverseModel {
    /// `A` \[1/s\].
    a: Matrix3<f64>,
    /// `B^-1` \[unit of the input per rad/s^2\].
    b_inverse: Matrix3<f64>,
}

/// The law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Indi<I> {
    options: IndiOptions,
    input: I,
    /// Inverse of the rate model; `None` if the rate follows the input without a lag.
    model: Option<InverseModel>,
    filter: FilteredRate,
    /// The last inputs, the newest first \[N m, body axes, in rate form -1..1\].
    sent: [Vector3<f64>; MOST_TICKS + 1],
    /// Delayed input behind the filter \[N m, body axes, in rate form -1..1\].
    input_f: Vector3<f64>,
    terms: LawTerms,
}

impl<I: InputForm> Indi<I> {
    /// The law with these options.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: IndiOptions, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let invert =
            |RateModel { a, b }: RateModel| Some(InverseModel { a, b_inverse: b.try_inverse()? });
        Ok(Self {
            model: input.rate_model().and_then(invert),
            filter: FilteredRate::new(options.cutoff_hz),
            sent: [Vector3::zeros(); MOST_TICKS + 1],
            input_f: Vector3::zeros(),
            terms: LawTerms::default(),
            options,
            input,
        })
    }

    /// Input that corrects the filtered one.
    fn increment(&self, state: &AttitudeState, reference: &AttitudeReference) -> Vector3<f64> {
        let IndiOptions { attitude_gain_per_s, rate_gain_per_s, feed_forward, .. } = self.options;
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        let omega = state.rate.0;
        let (mut rate, mut acceleration) = (Vector3::zeros(), Vector3::zeros());
        if feed_forward {
            rate = error.rotation() * reference.rate.0;
            acceleration = error.reference_acceleration(&omega_e, reference).0;
        }
        rate -= 2.0 * attitude_gain_per_s * error.eps();
        let Some(InverseModel { a, b_inverse }) = &self.model else {
            return self.input.input_for(&(rate - self.filter.rate()));
        };
        let nu = rate_gain_per_s * (rate - omega) + acceleration;
        b_inverse * (nu - self.filter.acceleration() - a * (omega - self.filter.rate()))
    }
}

impl<I: InputForm> AttitudeLaw for Indi<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let share = self.filter.step(&state.rate.0, dt_s);
        self.input_f += share * (self.sent[self.options.input_delay_ticks] - self.input_f);
        let u = self.input_f + self.increment(state, reference);
        self.terms = LawTerms::of(&u, self.input_f, Vector3::zeros());
        let u = self.input.saturate(&u);
        self.sent.rotate_right(1);
        self.sent[0] = u;
        I::command_from(u)
    }

    fn reset(&mut self) {
        self.filter.reset();
        self.sent = [Vector3::zeros(); MOST_TICKS + 1];
        self.input_f = Vector3::zeros();
    }

    fn yield_to(&mut self, u: &Vector3<f64>) {
        self.sent[0] = *u;
    }

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::RateInput;
    use crate::quantity::BodyRate;
    use crate::quaternion::Attitude;

    const DT_S: f64 = 1e-3;

    /// With a rate loop whose lag and drift are unknown to the model, the attitude still reaches the reference.
    #[test]
    fn an_unknown_drift_leaves_no_error() {
        let input = RateInput::new(Vector3::repeat(2.0)).unwrap().with_lag(0.05, DT_S).unwrap();
        let options = IndiOptions { input_delay_ticks: 0, ..IndiOptions::default() };
        let drift = Vector3::new(0.05, -0.03, 0.02);
        let left = |options: IndiOptions| {
            let mut law = Indi::new(options, input).unwrap();
            let mut state = AttitudeState::default();
            for _ in 0..8000 {
                let sticks = law.update(&state, &AttitudeReference::default(), DT_S).0;
                let rate = state.rate.0 + (2.0 * sticks + drift - state.rate.0) * DT_S / 0.05;
                let attitude = state.attitude.turned_by(rate * DT_S);
                state = AttitudeState { attitude, rate: BodyRate(rate) };
            }
            state.attitude.angle_to(&Attitude::LEVEL)
        };
        assert!(left(options) < 1e-4, "{}", left(options));
        // Almost without increments the law inverts the model, and the drift causes an error.
        assert!(left(IndiOptions { cutoff_hz: 1e-3, ..options }) > 1e-3);
    }

    /// With an exact model, the angular acceleration equals the demanded one from the first step on.
    #[test]
    fn the_demanded_acceleration_is_made_at_once() {
        let input = RateInput::new(Vector3::repeat(2.0)).unwrap().with_lag(0.05, DT_S).unwrap();
        let options = IndiOptions::default();
        let mut law = Indi::new(options, input).unwrap();
        let attitude = Attitude::from_rotation_vector(Vector3::new(1e-3, 0.0, 0.0));
        let state = AttitudeState { attitude, ..AttitudeState::default() };
        let sticks = law.update(&state, &AttitudeReference::default(), DT_S).0;
        let expected = -options.rate_gain_per_s * options.attitude_gain_per_s * 1e-3;
        assert!((2.0 * sticks.x / 0.05 - expected).abs() < 1e-7);
    }
}
