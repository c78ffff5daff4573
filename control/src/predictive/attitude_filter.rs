//! A multiplicative Kalman filter for attitude, rate and the bias of the demand.
//!
//! The vehicle model propagates the attitude; the filter estimates the error of that attitude, a rotation vector,
//! which a correction moves into the attitude (Lefferts, Markley and Shuster, *J. Guidance* 5, 1982). About one axis
//! the error `[theta; omega; d]` follows the model; the coupling of the axes, of the size of the angle turned between
//! two poses, is neglected.

use nalgebra::{Matrix3, Matrix3x1, Vector3};

use super::kalman::{AxisFilter, StateTransition};
use super::model::{Motion, Rotation};
use super::options::FilterOptions;
use crate::linear::discretise;

/// Standard deviations at take-off: of rate \[rad/s\] and bias \[as the demand\].
const INITIAL: [f64; 2] = [0.1, 0.05];

/// Limit of each bias component \[as the demand\].
const BIAS_LIMIT: f64 = 1.0;

/// Kalman filter of the attitude error. The corrected motion is passed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeFilter {
    /// Covariance of `[theta; omega; d]` about each axis, and `d`, the bias of the demand \[rad/s or rad/s^2, body axes\].
    pub axis: AxisFilter,
}

impl AttitudeFilter {
    /// A filter with zero bias.
    pub fn new(options: &FilterOptions) -> Self {
        let walks = [options.rate_walk_rad_s, options.demand_bias_walk];
        let noise = options.attitude_noise_deg.to_radians();
        Self { axis: AxisFilter::new(noise, INITIAL, walks, Vector3::repeat(BIAS_LIMIT)) }
    }

    /// Transition of the error over `dt_s` \[s\].
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
        StateTransition::new(f, self.axis.walks(), h)
    }

    /// Corrects `motion` by this innovation \[rad, body axes\] of a measurement with standard deviation `noise` \[rad\]. Returns
    /// the gain from it to `[theta; omega; d]`.
    pub fn correct(
        &mut self,
        motion: &mut Motion,
        innovation: &Vector3<f64>,
        noise: f64,
    ) -> Vector3<f64> {
        let gain = self.axis.correct(innovation, noise);
        motion.attitude = motion.attitude.turned_by(innovation * gain.x);
        motion.rate += innovation * gain.y;
        gain
    }
}
