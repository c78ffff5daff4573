//! Motion and input of a vehicle on its reference: a quadrotor is differentially flat.

use oqtal_control::predictive::{Bias, Course, Force, ModelInput, Motion};
use oqtal_control::trajectory::Reference;

use crate::law::RateVehicle;

/// Motion of a vehicle on its reference, and the input that keeps it there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatPoint {
    /// The motion.
    pub motion: Motion,
    /// The input.
    pub input: ModelInput,
}

impl FlatPoint {
    /// The point of `vehicle` on `reference` under the disturbances `bias`.
    pub fn of(reference: &Reference, vehicle: &RateVehicle, bias: &Bias) -> Self {
        let mut force =
            Force::along(&Course::of(reference), vehicle.gravity_m_s2, vehicle.drag_per_s);
        force.value -= bias.acceleration;
        // Sun et al., Eqs. (14) to (24): attitude, rate and acceleration of the force
        let attitude = force.attitude(reference.yaw_after(0.0));
        let thrust_n = vehicle.mass_kg * force.value.norm();
        let growth = vehicle.mass_kg * thrust_growth(&force);
        let rate = attitude.rate.0;
        Self {
            motion: Motion {
                position: reference.position,
                velocity: reference.velocity,
                attitude: attitude.attitude,
                rate,
                thrust_n,
            },
            input: ModelInput {
                demand: rate + attitude.acceleration.0 * vehicle.rate_lag_s - bias.demand,
                thrust_n: thrust_n + growth * vehicle.thrust_lag_s,
                ..ModelInput::default()
            },
        }
    }
}

/// Change of the magnitude of `force` \[m/s^3\]; zero without a force.
pub fn thrust_growth(force: &Force) -> f64 {
    let norm = force.value.norm();
    if norm > f64::EPSILON { force.value.dot(&force.slope) / norm } else { 0.0 }
}
