//! Attitude, rate and angular acceleration that produce a given force: a quadrotor is differentially flat (Mellinger
//! and Kumar, *ICRA* 2011).

use nalgebra::Vector3;

use super::reference_model::Course;
use crate::position::attitude_along;
use crate::quantity::{AngularAcceleration, BodyRate};
use crate::tracking_error::AttitudeReference;

/// Time over which the attitude is differenced for its derivatives \[s\]: short compared with the effect of jerk, long compared
/// with rounding errors.
const DIFFERENCE_S: f64 = 5e-3;

/// Force per mass with its first two time derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// Force per mass \[m/s^2, world\].
    pub value: Vector3<f64>,
    /// First derivative \[m/s^3, world\].
    pub slope: Vector3<f64>,
    /// Second derivative \[m/s^4, world\].
    pub curvature: Vector3<f64>,
}

impl Force {
    /// The force with which a vehicle with the drag `drag_per_s` \[1/s\] follows `course` under `gravity_m_s2` \[m/s^2\].
    pub fn along(course: &Course, gravity_m_s2: f64, drag_per_s: f64) -> Self {
        Self {
            value: course.acceleration + course.velocity * drag_per_s + Vector3::z() * gravity_m_s2,
            slope: course.jerk + course.acceleration * drag_per_s,
            curvature: course.snap + course.jerk * drag_per_s,
        }
    }

    fn at(&self, t_s: f64) -> Vector3<f64> {
        self.value + (self.slope + self.curvature * (t_s / 2.0)) * t_s
    }

    /// The attitude whose body z axis points along the force, with its rate and angular acceleration; `yaw` is the 3-2-1 yaw with its
    /// first two derivatives \[rad, s\].
    pub fn attitude(&self, yaw: [f64; 3]) -> AttitudeReference {
        let h = DIFFERENCE_S;
        let [yaw_rad, rate, acceleration] = yaw;
        let yaw_at = |t_s: f64| yaw_rad + (rate + acceleration * (t_s / 2.0)) * t_s;
        let [before, now, after] =
            [-h, 0.0, h].map(|t_s| attitude_along(&self.at(t_s), yaw_at(t_s)));
        let (back, forth) = (now.rotation_to(&before), now.rotation_to(&after));
        AttitudeReference {
            attitude: now,
            rate: BodyRate((forth - back) / (2.0 * h)),
            acceleration: AngularAcceleration((forth + back) / (h * h)),
        }
    }
}
