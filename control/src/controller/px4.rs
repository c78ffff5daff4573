//! The attitude control of PX4, a widely used autopilot: reduced attitude with a weight on yaw, and a rate loop. Not in the paper.
//!
//! ```text
//! q_d' = q (x) reduced (x) [0, 0, sin(w psi/2), cos(w psi/2)]     the tilt of q_d first, then the share w of its turn about z
//! omega_sp = -2 k W eps(q_d', q) + C omega_d,  W = diag(1, 1, 1/w)
//! u = J (k_p (omega_sp - omega) + k_i Int(omega_sp - omega) - k_d omega_dot)
//! ```
//!
//! Sources: D. Brescianini, M. Hehn and R. D'Andrea, *Nonlinear Quadrocopter Attitude Control*, ETH Zurich 2013, and the
//! controller diagrams of PX4's documentation. With rate input the vehicle's own loop replaces the rate loop, and the command is
//! `omega_sp`. Differences from the source: PX4 feeds only the rate about the vertical forward; gains of the rate loop are per
//! inertia, so that one set suits bodies of different inertia.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::filtered_rate::FilteredRate;
use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use crate::integral::Integral;
use crate::options::{OptionError, Rule, check_options};
use crate::quaternion::Attitude;
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Norm of the quaternion between two opposite thrust directions \[-\], below which the full attitude error is used, as in the
/// source, since any axis turns one direction to the other.
const UPSIDE_DOWN: f64 = 1e-9;

/// Options of [`Px4Attitude`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Px4Options {
    /// `k`, the gain from attitude to rate (`MC_ROLL_P`) \[1/s\].
    pub attitude_gain_per_s: f64,
    /// `w`: weight of the heading in the target attitude (`MC_YAW_WEIGHT`) \[-\].
    pub yaw_weight: f64,
    /// Greatest commanded rate about each axis (`MC_ROLLRATE_MAX`) \[rad/s\].
    pub max_rate_rad_s: f64,
    /// `k_p`: angular acceleration per error of the rate \[1/s\]; torque input only.
    pub rate_gain_per_s: f64,
    /// `k_i` per `k_p` \[1/s\]; torque input only.
    pub rate_integral_per_s: f64,
    /// `k_d`: fraction of the measured angular acceleration that is opposed \[-\]; torque input only.
    pub rate_derivative: f64,
    /// Cut-off frequency of the measured angular acceleration \[Hz\]; torque input only.
    pub derivative_cutoff_hz: f64,
    /// Limit of each component of the integral of the rate's error \[rad\]; torque input only.
    pub integral_limit_rad: f64,
    /// Whether the reference's motion is fed forward.
    pub feed_forward: bool,
}

impl Default for Px4Options {
    fn default() -> Self {
        Self {
            attitude_gain_per_s: 6.5,
            yaw_weight: 0.4,
            max_rate_rad_s: 3.84,
            rate_gain_per_s: 22.0,
            rate_integral_per_s: 0.5,
            rate_derivative: 0.0,
            derivative_cutoff_hz: 20.0,
            integral_limit_rad: 0.2,
            feed_forward: true,
        }
    }
}

impl Px4Options {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] =
        &[SearchRange::new("attitude-gain-per-s", 1.0, 40.0)];

    /// Gains for the paper's spacecraft in torque form.
    pub fn spacecraft() -> Self {
        Self {
            attitude_gain_per_s: 4.0,
            rate_gain_per_s: 16.0,
            rate_integral_per_s: 0.1,
            ..Self::default()
        }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-gain-per-s", self.attitude_gain_per_s, Rule::Positive),
            ("yaw-weight", self.yaw_weight, Rule::Between(0.01, 1.0)),
            ("max-rate-rad-s", self.max_rate_rad_s, Rule::PositiveOrInfinite),
            ("rate-gain-per-s", self.rate_gain_per_s, Rule::NotNegative),
            ("rate-integral-per-s", self.rate_integral_per_s, Rule::NotNegative),
            ("rate-derivative", self.rate_derivative, Rule::NotNegative),
            ("derivative-cutoff-hz", self.derivative_cutoff_hz, Rule::Positive),
            ("integral-limit-rad", self.integral_limit_rad, Rule::NotNegative),
        ])
    }
}

/// The law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4Attitude<I> {
    options: Px4Options,
    input: I,
    filter: FilteredRate,
    integral: Integral,
    terms: LawTerms,
}

/// Target attitude: the thrust direction of `desired`, and the fraction `weight` of the remaining rotation about it.
fn weighted(desired: &Attitude, actual: &Attitude, weight: f64) -> Attitude {
    let [z, z_d] = [actual, desired].map(|attitude| attitude.to_world(&Vector3::z()));
    let axis = z.cross(&z_d);
    // The quaternion of half the angle between the two, exact for small angles too.
    let tilt = Quaternion::new(1.0 + z.dot(&z_d), axis.x, axis.y, axis.z);
    let Some(tilt) = UnitQuaternion::try_new(tilt, UPSIDE_DOWN) else { return *desired };
    let reduced = tilt * actual.unit_quaternion();
    // The remaining rotation is about z.
    let left = (reduced.inverse() * desired.unit_quaternion()).into_inner();
    // Half a turn is taken about +z, for either sign of the quaternion.
    let is_negative = left.w < 0.0 || (left.w == 0.0 && left.k < 0.0);
    let sign = if is_negative { -1.0 } else { 1.0 };
    let turn = 2.0 * (sign * left.k).atan2(sign * left.w);
    Attitude::from_unit_quaternion(reduced).turned_by(weight * turn * Vector3::z())
}

impl<I: InputForm> Px4Attitude<I> {
    /// The law with these options.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: Px4Options, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let filter = FilteredRate::new(options.derivative_cutoff_hz);
        let integral = Integral::new(options.integral_limit_rad);
        Ok(Self { options, input, filter, integral, terms: LawTerms::default() })
    }

    /// Corrective rate \[rad/s, body axes\].
    fn correction(&self, state: &AttitudeState, reference: &AttitudeReference) -> Vector3<f64> {
        let Px4Options { attitude_gain_per_s, yaw_weight, .. } = self.options;
        let target = weighted(&reference.attitude, &state.attitude, yaw_weight);
        let eps = *AttitudeError::between(&target, &state.attitude).eps();
        // The weight slows down large rotations of the heading, not small ones.
        let weights = Vector3::new(1.0, 1.0, yaw_weight.recip());
        -2.0 * attitude_gain_per_s * eps.component_mul(&weights)
    }

    /// Input that produces the rate `omega_sp`, with the rate loop for a body commanded by torque.
    fn rate_loop(
        &mut self,
        omega: Vector3<f64>,
        omega_sp: Vector3<f64>,
        dt_s: f64,
    ) -> Vector3<f64> {
        let Px4Options { rate_gain_per_s, rate_integral_per_s, rate_derivative, .. } = self.options;
        let error = omega_sp - omega;
        self.filter.step(&omega, dt_s);
        let by_integral = rate_integral_per_s * rate_gain_per_s;
        let integral = by_integral * self.integral.value();
        let demand =
            rate_gain_per_s * error + integral - rate_derivative * self.filter.acceleration();
        let u = self.input.input_for(&demand);
        self.terms.integral = self.input.input_for(&integral);
        let push = self.input.input_for(&(by_integral * error));
        self.integral.step(&error, &push, &(u - self.input.saturate(&u)), dt_s);
        u
    }
}

impl<I: InputForm> AttitudeLaw for Px4Attitude<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let limit = self.options.max_rate_rad_s;
        let limited = |rate: Vector3<f64>| rate.map(|omega| omega.clamp(-limit, limit));
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        let correction = self.correction(state, reference);
        let moves = self.options.feed_forward;
        let (mut rate_d, mut feed_forward) = (Vector3::zeros(), Vector3::zeros());
        if moves {
            rate_d = error.rotation() * reference.rate.0;
            feed_forward = self.input.feed_forward(&error, &omega_e, reference);
        }
        let mut u = match self.input.inertia() {
            Some(_) => self.rate_loop(state.rate.0, limited(correction + rate_d), dt_s),
            None => self.input.input_for(&limited(correction)),
        };
        u += feed_forward;
        self.terms = LawTerms::of(&u, self.terms.integral, feed_forward);
        I::command_from(self.input.saturate(&u))
    }

    fn reset(&mut self) {
        self.filter.reset();
        self.integral.reset();
    }

    fn yield_to(&mut self, _u: &Vector3<f64>) {
        self.integral.undo();
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
    use crate::quantity::StickCommand;

    fn sticks(turn: Vector3<f64>, options: Px4Options) -> Vector3<f64> {
        let input = RateInput::new(Vector3::repeat(2.0)).unwrap();
        let mut law = Px4Attitude::new(options, input).unwrap();
        let state = AttitudeState {
            attitude: Attitude::from_rotation_vector(turn),
            ..AttitudeState::default()
        };
        let StickCommand(sticks) = law.update(&state, &AttitudeReference::default(), 1.0 / 60.0);
        sticks
    }

    #[test]
    fn small_errors_are_corrected_alike_about_every_axis() {
        for axis in 0..3 {
            let mut turn = Vector3::zeros();
            turn[axis] = 1e-4;
            let expected = -turn * Px4Options::default().attitude_gain_per_s / 2.0;
            assert!((sticks(turn, Px4Options::default()) - expected).amax() < 1e-9);
        }
    }

    /// Large errors of tilt and heading: the tilt is corrected about the shortest axis, as fast as without a heading error.
    #[test]
    fn the_direction_of_thrust_comes_before_the_heading() {
        let slow = Px4Options { attitude_gain_per_s: 1.0, ..Px4Options::default() };
        let tilted = Attitude::from_rotation_vector(Vector3::new(0.5, 0.0, 0.0));
        let state = |heading: f64| {
            let turned = tilted.turned_by(Vector3::new(0.0, 0.0, heading));
            turned.rotation_to(&Attitude::LEVEL).norm()
        };
        assert!(state(2.0) > state(0.0));
        let alone = weighted(&Attitude::LEVEL, &tilted, slow.yaw_weight);
        let rate = -AttitudeError::between(&alone, &tilted).eps();
        let turned = tilted.turned_by(Vector3::new(0.0, 0.0, 2.0));
        let target = weighted(&Attitude::LEVEL, &turned, 0.01);
        let with_heading = -AttitudeError::between(&target, &turned).eps();
        assert!((rate.xy().norm() - with_heading.xy().norm()).abs() < 1e-3);
        assert!(with_heading.z.abs() < 0.02, "{with_heading}");
    }

    #[test]
    fn the_share_of_the_heading_is_its_weight() {
        let turned = Attitude::from_rotation_vector(Vector3::new(0.0, 0.0, -1.2));
        let target = weighted(&Attitude::LEVEL, &turned, 0.4);
        assert!((turned.angle_to(&target) - 0.48).abs() < 1e-12);
    }
}
