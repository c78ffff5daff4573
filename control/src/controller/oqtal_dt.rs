//! `oqtal-dt`: OQTAL designed in discrete time, for the sampled loop. Not in the paper.
//!
//! ```text
//! u = -K [omega_e; eps] + J (C omega_d_dot - omega_e x C omega_d) + omega x J omega
//! ```
//!
//! - `K` solves the discrete-time Riccati equation for the sampled plant under a held input, so
//!   that the loop is stable for any weights; the paper's gains are unstable at 60 Hz from
//!   `q/r = 2^12` on.
//! - Attitude and rate have separate weights. With equal weights, as in the paper, one pole stays
//!   at 0.5 rad/s for any weights.
//! - The reference's motion is fed forward. For a commanded rate the lag of the vehicle's own loop
//!   takes the place of the inertia: see [`InputForm::feed_forward`].
//! - Far from the reference the rate is limited to a value that can still be braked in time; otherwise a high gain with a limited
//!   torque repeatedly overshoots the reference. The limit shortens `eps` in `K_omega omega_e = -K_eps eps`.
//!
//! There is one gain, designed at zero error: in every other cell the exact model differs only by a rotation and by `lambda`,
//! which stays within 1 % of one below 15 degrees. There is no integral action: [`crate::predictive`] estimates steady
//! disturbances.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use crate::linear::discretise;
use crate::options::{OptionError, Rule, check_options};
use crate::riccati::{RiccatiError, dare};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// `K` of `u = -K [omega_e; eps]`.
pub type DiscreteGain = SMatrix<f64, 3, 6>;

/// Options of [`OqtalDt`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OqtalDtOptions {
    /// Weight on `eps` \[-\].
    pub attitude_weight: f64,
    /// Weight on `omega_e` \[s^2/rad^2\].
    pub rate_weight: f64,
    /// Weight on the input \[-\].
    pub input_weight: f64,
}

impl Default for OqtalDtOptions {
    fn default() -> Self {
        // Found by an evolution strategy over flights of the nominal vehicle and of two mismatched ones.
        Self { attitude_weight: 1250.0, rate_weight: 0.0125, input_weight: 1.0 }
    }
}

impl OqtalDtOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-weight", 100.0, 1e5),
        SearchRange::new("rate-weight", 1e-3, 10.0),
    ];

    /// Gains for the paper's spacecraft in torque form.
    pub fn spacecraft() -> Self {
        // 2^20 and 2^6 over 1
        Self { attitude_weight: 1_048_576.0, rate_weight: 64.0, input_weight: 1.0 }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-weight", self.attitude_weight, Rule::Positive),
            ("rate-weight", self.rate_weight, Rule::NotNegative),
            ("input-weight", self.input_weight, Rule::Positive),
        ])
    }
}

/// The law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OqtalDt<I> {
    input: I,
    gain: DiscreteGain,
    /// `K_omega^-1 K_eps`: the commanded rate per `eps` \[rad/s\]. Zero if the rate is not a state.
    turn: Matrix3<f64>,
    braking: f64,
    terms: LawTerms,
}

impl<I: InputForm> OqtalDt<I> {
    /// The law with these options for a loop that runs every `period_s` \[s\]. Its only Riccati equation is solved here.
    ///
    /// # Errors
    /// An option whose value is not allowed, or weights so different that there is no gain.
    pub fn new(options: OqtalDtOptions, input: I, period_s: f64) -> Result<Self, OptionError> {
        options.check()?;
        check_options([("period-s", period_s, Rule::Positive)])?;
        let gain = Self::gain_for(&options, &input, period_s).map_err(|_| {
            let allowed =
                "nearer to the other weights: the Riccati equation has no usable solution";
            OptionError::new("attitude-weight", options.attitude_weight, allowed)
        })?;
        let part = |column| gain.fixed_view::<3, 3>(0, column).into_owned();
        let turn = part(0).try_inverse().map_or_else(Matrix3::zeros, |inverse| inverse * part(3));
        let braking = input.braking();
        Ok(Self { input, gain, turn, braking, terms: LawTerms::default() })
    }

    /// Sampled plant `(A, B)` for the state `[omega_e; eps]` at zero error. If the rate follows the input at once, only the rows
    /// of `eps` are meaningful.
    pub fn plant(input: &I, period_s: f64) -> (Matrix6<f64>, Matrix6x3<f64>) {
        let (mut a, mut b) = (Matrix6::zeros(), Matrix6x3::zeros());
        let half = Matrix3::from_diagonal_element(0.5);
        match input.rate_model() {
            Some(rate) => {
                a.fixed_view_mut::<3, 3>(0, 0).copy_from(&rate.a);
                b.fixed_view_mut::<3, 3>(0, 0).copy_from(&rate.b);
                // Eq. (44) at the error zero
                a.fixed_view_mut::<3, 3>(3, 0).copy_from(&half);
            }
            None => {
                let mut kinematics = Matrix6::zeros();
                kinematics.fixed_view_mut::<3, 3>(3, 0).copy_from(&half);
                b = input.input_matrix(&kinematics);
            }
        }
        discretise(&a, &b, period_s)
    }

    fn gain_for(
        options: &OqtalDtOptions,
        input: &I,
        period_s: f64,
    ) -> Result<DiscreteGain, RiccatiError> {
        let (a, b) = Self::plant(input, period_s);
        let weights = [options.rate_weight, options.attitude_weight];
        let q = Matrix6::from_diagonal(&SVector::from_fn(|i, _| weights[i / 3]));
        let r = Matrix3::from_diagonal_element(options.input_weight);
        if input.rate_model().is_some() {
            return Ok(dare(&a, &b, &q, &r)?.k);
        }
        let part = |matrix: &Matrix6<f64>| matrix.fixed_view::<3, 3>(3, 3).into_owned();
        let b = b.fixed_view::<3, 3>(3, 0).into_owned();
        let mut gain = DiscreteGain::zeros();
        let k = dare(&part(&a), &b, &part(&q), &r)?.k;
        gain.fixed_view_mut::<3, 3>(0, 3).copy_from(&k);
        Ok(gain)
    }

    /// The input form of the vehicle.
    pub(super) fn into_input(self) -> I {
        self.input
    }

    /// The gain `K` of `u = -K [omega_e; eps]`.
    pub fn gain(&self) -> &DiscreteGain {
        &self.gain
    }

    /// `eps`, shortened until the commanded rate can be braked within it.
    fn stoppable(&self, eps: &Vector3<f64>) -> Vector3<f64> {
        // omega^2 = 2 a angle, and the angle is at least twice eps.
        let fastest = (4.0 * self.braking * eps.norm()).sqrt();
        let rate = (self.turn * eps).norm();
        if rate > fastest { eps * (fastest / rate) } else { *eps }
    }

    /// `u` before the vehicle's limits are applied \[N m, body axes, in rate form -1..1\].
    pub fn input(&mut self, state: &AttitudeState, reference: &AttitudeReference) -> Vector3<f64> {
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        let mut x = SVector::<f64, 6>::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&omega_e);
        x.fixed_rows_mut::<3>(3).copy_from(&self.stoppable(error.eps()));
        let feed_forward = self.input.feed_forward(&error, &omega_e, reference)
            + self.input.gyroscopic(state.rate);
        let u = feed_forward - self.gain * x;
        self.terms = LawTerms::of(&u, Vector3::zeros(), feed_forward);
        u
    }
}

impl<I: InputForm> AttitudeLaw for OqtalDt<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        _: f64,
    ) -> I::Command {
        let u = self.input(state, reference);
        I::command_from(self.input.saturate(&u))
    }

    fn reset(&mut self) {}

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }

    fn riccati_solves(&self) -> u32 {
        1
    }
}
