//! A Kalman filter for position, velocity and external acceleration: wind, or a thrust or mass other than configured.

use nalgebra::{Matrix3, Vector3};

use super::kalman::{Covariance, StateTransition};
use super::model::Motion;
use super::options::FilterOptions;

/// Standard deviations at take-off: of velocity \[m/s\] and acceleration \[m/s^2\].
const INITIAL_VELOCITY: f64 = 0.05;
const INITIAL_ACCELERATION: f64 = 0.3;

/// Limit of each component of the external acceleration of an autopilot \[m/s^2\].
const BIAS_LIMIT: f64 = 3.0;

/// Kalman filter of the position error. The motion that it corrects is passed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionFilter {
    noise: f64,
    velocity_walk: f64,
    bias_walk: f64,
    bias_limit: f64,
    covariance: Covariance,
    bias: Vector3<f64>,
}

impl PositionFilter {
    /// A filter with zero external acceleration.
    #[must_use]
    pub fn new(options: &FilterOptions) -> Self {
        let noise = options.position_noise_mm * 1e-3;
        Self {
            noise,
            velocity_walk: options.velocity_walk_m_s,
            bias_walk: options.acceleration_walk_m_s2,
            bias_limit: BIAS_LIMIT,
            covariance: Covariance::of([noise, INITIAL_VELOCITY, INITIAL_ACCELERATION]),
            bias: Vector3::zeros(),
        }
    }

    /// The filter with another limit of each component of the external acceleration \[m/s^2\].
    #[must_use]
    pub fn with_bias_limit(self, bias_limit: f64) -> Self {
        Self { bias_limit, ..self }
    }

    /// Sets the external acceleration to zero.
    pub fn forget_bias(&mut self) {
        self.bias = Vector3::zeros();
    }

    /// Estimated external acceleration \[m/s^2, world\].
    #[must_use]
    pub fn bias(&self) -> &Vector3<f64> {
        &self.bias
    }

    /// The covariance of position, velocity and acceleration along each axis.
    #[must_use]
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Transition of the error over `dt_s` \[s\] under `drag_per_s` \[1/s\].
    #[must_use]
    pub fn transition(&self, drag_per_s: f64, dt_s: f64) -> StateTransition {
        let h = dt_s;
        #[rustfmt::skip]
        let f = Matrix3::new(
            1.0, h, h * h / 2.0,
            0.0, (-drag_per_s * h).exp(), h,
            0.0, 0.0, 1.0,
        );
        StateTransition::new(f, self.velocity_walk, self.bias_walk, h)
    }

    /// Propagates the covariance over `dt_s` \[s\].
    pub fn predict(&mut self, drag_per_s: f64, dt_s: f64) {
        let transition = self.transition(drag_per_s, dt_s);
        self.covariance.predict(&transition);
    }

    /// Variance of the next innovation along each axis \[m^2\].
    #[must_use]
    pub fn innovation_variance(&self) -> f64 {
        self.covariance.0[(0, 0)] + self.noise * self.noise
    }

    /// Corrects `motion` by the position measured \[m, world\]; returns the innovation \[m\].
    pub fn correct(&mut self, motion: &mut Motion, measured: &Vector3<f64>) -> Vector3<f64> {
        let innovation = measured - motion.position;
        self.correct_by(motion, &innovation, self.noise);
        innovation
    }

    /// Corrects `motion` by this innovation \[m\], of a measurement with standard deviation `noise` \[m\].
    pub fn correct_by(&mut self, motion: &mut Motion, innovation: &Vector3<f64>, noise: f64) {
        let gain = self.covariance.correct(noise);
        motion.position += innovation * gain.x;
        motion.velocity += innovation * gain.y;
        let limit = self.bias_limit;
        self.bias = (self.bias + innovation * gain.z).map(|b| b.clamp(-limit, limit));
    }
}
