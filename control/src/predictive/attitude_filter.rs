//! A multiplicative Kalman filter for attitude, rate and the bias of the demand.
//!
//! The vehicle model propagates the attitude; the filter estimates the error of that attitude, a rotation vector,
//! which a correction moves into the attitude (Lefferts, Markley and Shuster, *J. Guidance* 5, 1982). About one axis
//! the error `[theta; omega; d]` follows the model; the coupling of the axes, of the size of the angle turned between
//! two poses, is neglected.

use nalgebra::{Matrix3, Matrix3x1, Vector3};

use super::kalman::{Covariance, StateTransition};
use super::model::{Motion, Rotation};
use super::options::FilterOptions;
use crate::linear::discretise;
use crate::quaternion::Attitude;

/// Standard deviations at take-off: of rate \[rad/s\] and bias \[as the demand\].
const INITIAL_RATE: f64 = 0.1;
const INITIAL_BIAS: f64 = 0.05;

/// Limit of each bias component \[as the demand\].
const BIAS_LIMIT: f64 = 1.0;

/// Kalman filter of the attitude error. The motion that it corrects is passed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeFilter {
    noise: f64,
    rate_walk: f64,
    bias_walk: f64,
    covariance: Covariance,
    bias: Vector3<f64>,
}

impl AttitudeFilter {
    /// A filter with zero bias.
    #[must_use]
    pub fn new(options: &FilterOptions) -> Self {
        let noise = options.attitude_noise_deg.to_radians();
        Self {
            noise,
            rate_walk: options.rate_walk_rad_s,
            bias_walk: options.demand_bias_walk,
            covariance: Covariance::of([noise, INITIAL_RATE, INITIAL_BIAS]),
            bias: Vector3::zeros(),
        }
    }

    /// Sets the bias to zero.
    pub fn forget_bias(&mut self) {
        self.bias = Vector3::zeros();
    }

    /// `d`: the bias of the demand \[rad/s or rad/s^2, body axes\].
    #[must_use]
    pub fn bias(&self) -> &Vector3<f64> {
        &self.bias
    }

    /// The covariance of `[theta; omega; d]` about each axis.
    #[must_use]
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Transition of the error over `dt_s` \[s\].
    #[must_use]
    pub fn transition(&self, rotation: &Rotation, dt_s: f64) -> StateTransition {
        let h = dt_s;
        #[rustfmt::skip]
        let f = match rotation {
            Rotation::RateLoop { lag_s } => {
                let decay = (-h / lag_s).exp();
                let turn = lag_s * (1.0 - decay);
                Matrix3::new(
                    1.0, turn, h - turn,
                    0.0, decay, 1.0 - decay,
                    0.0, 0.0, 1.0,
                )
            }
            Rotation::AttitudeLoop { gain_per_s: gain, lag_s, .. } => {
                let a = Matrix3::new(
                    0.0, 1.0, 0.0,
                    -gain / lag_s, -1.0 / lag_s, 1.0 / lag_s,
                    0.0, 0.0, 0.0,
                );
                discretise(&a, &Matrix3x1::zeros(), h).0
            }
            Rotation::RigidBody { .. } => Matrix3::new(
                1.0, h, h * h / 2.0,
                0.0, 1.0, h,
                0.0, 0.0, 1.0,
            ),
        };
        StateTransition::new(f, self.rate_walk, self.bias_walk, h)
    }

    /// Propagates the covariance over `dt_s` \[s\].
    pub fn predict(&mut self, rotation: &Rotation, dt_s: f64) {
        let transition = self.transition(rotation, dt_s);
        self.covariance.predict(&transition);
    }

    /// Variance of the next innovation about each axis \[rad^2\].
    #[must_use]
    pub fn innovation_variance(&self) -> f64 {
        self.covariance.0[(0, 0)] + self.noise * self.noise
    }

    /// Corrects `motion` by the attitude measured; returns the innovation \[rad, body axes\].
    pub fn correct(&mut self, motion: &mut Motion, measured: &Attitude) -> Vector3<f64> {
        let innovation = motion.attitude.rotation_to(measured);
        self.correct_by(motion, &innovation, self.noise);
        innovation
    }

    /// Corrects `motion` by this innovation \[rad, body axes\], of a measurement with standard deviation `noise` \[rad\].
    pub fn correct_by(&mut self, motion: &mut Motion, innovation: &Vector3<f64>, noise: f64) {
        let gain = self.covariance.correct(noise);
        self.apply(motion, innovation, &gain);
    }

    /// Corrects `motion` by this innovation \[rad, body axes\]; returns the gain from it to `[theta; omega; d]`.
    pub fn correct_with_gain(
        &mut self,
        motion: &mut Motion,
        innovation: &Vector3<f64>,
    ) -> Vector3<f64> {
        let gain = self.covariance.correct(self.noise);
        self.apply(motion, innovation, &gain);
        gain
    }

    /// Adds to the bias \[as the demand, body axes\].
    pub fn shift_bias(&mut self, shift: &Vector3<f64>) {
        self.bias = (self.bias + shift).map(|d| d.clamp(-BIAS_LIMIT, BIAS_LIMIT));
    }

    fn apply(&mut self, motion: &mut Motion, innovation: &Vector3<f64>, gain: &Vector3<f64>) {
        motion.attitude = motion.attitude.turned_by(innovation * gain.x);
        motion.rate += innovation * gain.y;
        self.bias = (self.bias + innovation * gain.z).map(|d| d.clamp(-BIAS_LIMIT, BIAS_LIMIT));
    }
}
