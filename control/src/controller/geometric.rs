//! Geometric tracking control on SO(3), a widely used alternative. Not in the paper.
//!
//! ```text
//! u = -J (k_R e_R + k_Omega e_Omega + k_I e_I) + omega x J omega + J (C omega_d_dot - omega_e x C omega_d)
//! ```
//!
//! `e_R = (R_d'R - R'R_d)^v / 2` and `e_Omega = omega_e` (T. Lee, M. Leok and N. H. McClamroch, *IEEE
//! CDC* 2010); `e_I`, the integral of `e_Omega + c e_R`, is that of F.
//! Goodarzi, D. Lee and T. Lee, *ECC* 2013. With the error used here, `e_R = 2 lambda eps`: the sine
//! of the error angle, where OQTAL has the sine of half of it. It therefore fades towards half a
//! turn. Unlike in the source, gains are per inertia, so that one set of gains suits bodies of different inertia.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use crate::integral::Integral;
use crate::options::{OptionError, Rule, check_options};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Options of [`Geometric`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct GeometricOptions {
    /// `k_R` \[1/s^2, in rate form 1/s\].
    pub attitude_gain: f64,
    /// `k_Omega` \[1/s\]; without effect in rate form.
    pub rate_gain_per_s: f64,
    /// `k_I` per `k_R` \[1/s\]; 0 for no integral action.
    pub integral_gain_per_s: f64,
    /// `c`: weight of the attitude in the integral \[1/s\]; in rate form the integral is of `e_R`
    /// alone.
    pub integral_attitude_gain_per_s: f64,
    /// Limit of each component of `e_I` \[rad, in rate form rad s\].
    pub integral_limit: f64,
    /// Whether the reference's own motion is fed forward, as in the source.
    pub feed_forward: bool,
}

impl Default for GeometricOptions {
    fn default() -> Self {
        Self {
            attitude_gain: 8.0,
            rate_gain_per_s: 22.0,
            integral_gain_per_s: 0.5,
            integral_attitude_gain_per_s: 2.0,
            integral_limit: 0.5,
            feed_forward: true,
        }
    }
}

impl GeometricOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-gain", 1.0, 40.0),
        SearchRange::new("integral-gain-per-s", 0.01, 5.0),
    ];

    /// Gains for the paper's spacecraft in torque form.
    pub fn spacecraft() -> Self {
        Self {
            attitude_gain: 256.0,
            rate_gain_per_s: 32.0,
            integral_gain_per_s: 0.0,
            ..Self::default()
        }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-gain", self.attitude_gain, Rule::Positive),
            ("rate-gain-per-s", self.rate_gain_per_s, Rule::NotNegative),
            ("integral-gain-per-s", self.integral_gain_per_s, Rule::NotNegative),
            ("integral-attitude-gain-per-s", self.integral_attitude_gain_per_s, Rule::NotNegative),
            ("integral-limit", self.integral_limit, Rule::NotNegative),
        ])
    }
}

/// Law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometric<I> {
    options: GeometricOptions,
    input: I,
    e_i: Integral,
    terms: LawTerms,
}

impl<I: InputForm> Geometric<I> {
    /// Takes over the integral action of `old`, which flew until now.
    pub(super) fn adopt(&mut self, old: &Self) {
        self.e_i.adopt(&old.e_i);
    }

    /// The law with these options.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: GeometricOptions, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let e_i = Integral::new(options.integral_limit);
        Ok(Self { options, input, e_i, terms: LawTerms::default() })
    }
}

impl<I: InputForm> AttitudeLaw for Geometric<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let Self { options, input, .. } = self;
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let e_omega = error.rate_error(state.rate, reference.rate);
        let e_r = 2.0 * error.lambda() * error.eps();
        // In rate form the vehicle's own loop controls the rate.
        let (k_omega, e_i_dot) = match input.inertia() {
            Some(_) => {
                (options.rate_gain_per_s, e_omega + options.integral_attitude_gain_per_s * e_r)
            }
            None => (0.0, e_r),
        };
        let k_i = options.integral_gain_per_s * options.attitude_gain;
        let demand = options.attitude_gain * e_r + k_omega * e_omega + k_i * self.e_i.value();
        let gyroscopic = input.gyroscopic(state.rate);
        let mut u = gyroscopic - input.input_for(&demand);
        let mut feed_forward = gyroscopic;
        if options.feed_forward {
            let of_reference = input.feed_forward(&error, &e_omega, reference);
            u += of_reference;
            feed_forward += of_reference;
        }
        let integral = -input.input_for(&(k_i * self.e_i.value()));
        self.terms = LawTerms::of(&u, integral, feed_forward);

        let given = input.saturate(&u);
        let push: Vector3<f64> = -input.input_for(&(k_i * e_i_dot));
        self.e_i.step(&e_i_dot, &push, &(u - given), dt_s);
        I::command_from(given)
    }

    fn reset(&mut self) {
        self.e_i.reset();
    }

    fn yield_to(&mut self, _u: &Vector3<f64>) {
        self.e_i.undo();
    }

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }
}
