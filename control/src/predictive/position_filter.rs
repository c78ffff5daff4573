//! A Kalman filter for position, velocity and external acceleration: wind, or a thrust or mass other than configured.

use nalgebra::{Matrix3, Vector3};

use super::kalman::{AxisFilter, StateTransition};
use super::model::Motion;
use super::options::FilterOptions;

/// Standard deviations at take-off: of velocity \[m/s\] and acceleration \[m/s^2\].
const INITIAL: [f64; 2] = [0.05, 0.3];

/// Kalman filter of the position error. The caller passes the motion to be corrected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionFilter {
    /// Covariance of position, velocity and acceleration along each axis, and the external acceleration \[m/s^2, world\].
    pub axis: AxisFilter,
}

impl PositionFilter {
    /// A filter with zero external acceleration, which is limited to `limit` along each axis \[m/s^2, world\].
    pub fn new(options: &FilterOptions, limit: Vector3<f64>) -> Self {
        let walks = [options.velocity_walk_m_s, options.acceleration_walk_m_s2];
        Self { axis: AxisFilter::new(options.position_noise_mm * 1e-3, INITIAL, walks, limit) }
    }

    /// State transition of the error over `dt_s` \[s\] with the drag `drag_per_s` \[1/s\], and its process noise.
    pub fn transition(&self, drag_per_s: f64, dt_s: f64) -> StateTransition {
        let h = dt_s;
        #[rustfmt::skip]
        let f = Matrix3::new(
            1.0, h, h * h / 2.0,
            0.0, (-drag_per_s * h).exp(), h,
            0.0, 0.0, 1.0,
        );
        StateTransition::new(f, self.axis.walks(), h)
    }

    /// Corrects `motion` by this innovation \[m, world\], of a measurement with standard deviation `noise` \[m\].
    pub fn correct(&mut self, motion: &mut Motion, innovation: &Vector3<f64>, noise: f64) {
        let gain = self.axis.correct(innovation, noise);
        motion.position += innovation * gain.x;
        motion.velocity += innovation * gain.y;
    }
}
