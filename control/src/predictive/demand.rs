//! Demand of a reference on the vehicle: what it must do to follow exactly.

use nalgebra::Vector3;

use super::flatness::Force;
use super::model::VehicleModel;
use super::reference_model::Course;
use crate::trajectory::Reference;

/// Demand of a motion at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionDemand {
    /// Speed \[m/s\].
    pub speed_m_s: f64,
    /// Angle between thrust and vertical \[rad\].
    pub tilt_rad: f64,
    /// Thrust along body z \[N\].
    pub thrust_n: f64,
    /// Body rate \[rad/s, body axes\].
    pub rate: Vector3<f64>,
}

impl MotionDemand {
    /// The demand of `reference`, flown `slower` times as slowly \[-\], on a vehicle with this `model`.
    pub fn of(reference: &Reference, slower: f64, model: &VehicleModel) -> Self {
        let (course, [yaw_rad, rate, acceleration]) =
            (Course::of(reference), reference.yaw_after(0.0));
        let [s1, s2, s3, s4] = [1, 2, 3, 4].map(|order| slower.powi(-order));
        let course = Course {
            position: course.position,
            velocity: course.velocity * s1,
            acceleration: course.acceleration * s2,
            jerk: course.jerk * s3,
            snap: course.snap * s4,
        };
        let force = Force::along(&course, model.gravity_m_s2, model.drag_per_s);
        Self {
            speed_m_s: course.velocity.norm(),
            tilt_rad: force.value.xy().norm().atan2(force.value.z),
            thrust_n: model.mass_kg * force.value.norm(),
            rate: force.attitude([yaw_rad, rate * s1, acceleration * s2]).rate.0,
        }
    }
}
