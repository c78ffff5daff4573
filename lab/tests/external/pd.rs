//! A law outside the daemon: PD of the position, P of the attitude.

use nalgebra::Vector3;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_control::quaternion::Attitude;
use oqtal_daemon::ExternalLaw;

/// Greatest horizontal acceleration \[m/s^2\].
const SIDEWAYS: f64 = 2.6;

/// The law, with factors by which a test makes it worse.
#[derive(Clone, Copy, Debug)]
pub struct PositionPd {
    pub position_gain: f64,
    pub velocity_gain: f64,
    pub attitude_gain: f64,
}

impl Default for PositionPd {
    fn default() -> Self {
        Self { position_gain: 4.0, velocity_gain: 3.2, attitude_gain: 8.0 }
    }
}

impl PositionPd {
    pub fn command(&self, state: &StateV1) -> ExternalV1 {
        let [p, v, r, r_v, bias] = [
            state.position,
            state.velocity,
            state.reference_position,
            state.reference_velocity,
            state.acceleration_bias,
        ]
        .map(Vector3::from);
        let mut wanted = (r - p) * self.position_gain + (r_v - v) * self.velocity_gain;
        let sideways = wanted.xy().norm();
        if sideways > SIDEWAYS {
            wanted.x *= SIDEWAYS / sideways;
            wanted.y *= SIDEWAYS / sideways;
        }
        wanted.z = wanted.z.clamp(-4.0, 4.0);
        let force = wanted - bias + Vector3::z() * state.gravity;
        let attitude = Attitude::from_xyzw(state.attitude).unwrap();
        let tilt = Vector3::z().cross(&attitude.to_body(&force.normalize()));
        let [x, y, z, w] = state.attitude;
        let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
        let turn = tilt + Vector3::z() * (state.reference_yaw - yaw);
        let rate = turn * self.attitude_gain - Vector3::from(state.demand_bias);
        let most = Vector3::from(state.greatest_rate);
        let thrust = state.mass * force.dot(&attitude.to_world(&Vector3::z()));
        ExternalV1 {
            sequence: state.sequence,
            rate: rate.zip_map(&most, |rate, most| rate.clamp(-most, most)).into(),
            attitude: attitude.turned_by(turn).xyzw(),
            thrust: thrust.clamp(0.0, state.greatest_thrust),
            ..ExternalV1::default()
        }
    }
}

impl ExternalLaw for PositionPd {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        Some(self.command(state))
    }
}
