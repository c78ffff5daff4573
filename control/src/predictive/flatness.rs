//! From the force that the vehicle should give to the attitude it must have for that, and how that
//! attitude turns: a quadrotor is differentially flat (Mellinger and Kumar, *ICRA* 2011).

use nalgebra::Vector3;

use crate::position::attitude_along;
use crate::quantity::{AngularAcceleration, BodyRate};
use crate::tracking_error::AttitudeReference;

/// The derivatives of the attitude are differences over this time \[s\]: short against a jerk's
/// effect, long against rounding.
const DIFFERENCE_S: f64 = 5e-3;

/// A force over time, per mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// \[m/s^2, world\].
    pub value: Vector3<f64>,
    /// \[m/s^3, world\].
    pub slope: Vector3<f64>,
    /// \[m/s^4, world\].
    pub curvature: Vector3<f64>,
}

impl Force {
    fn at(&self, t_s: f64) -> Vector3<f64> {
        self.value + (self.slope + self.curvature * (t_s / 2.0)) * t_s
    }

    /// The attitude whose body z axis points along the force, at 3-2-1 yaw `yaw_rad`, with the rate
    /// and the acceleration at which it turns.
    #[must_use]
    pub fn attitude(&self, yaw_rad: f64) -> AttitudeReference {
        let h = DIFFERENCE_S;
        let [before, now, after] = [-h, 0.0, h].map(|t_s| attitude_along(&self.at(t_s), yaw_rad));
        let (back, forth) = (now.rotation_to(&before), now.rotation_to(&after));
        AttitudeReference {
            attitude: now,
            rate: BodyRate((forth - back) / (2.0 * h)),
            acceleration: AngularAcceleration((forth + back) / (h * h)),
        }
    }
}
