//! Rotation of the vehicle by its commands: the configured model, without any pose.

use nalgebra::Vector3;
use oqtal_control::predictive::{MotionTracker, Rotation};
use oqtal_control::quaternion::Attitude;

/// Time constant with which a rate that torques produce decays \[s\]: the integral of a wrong torque would grow without bound.
const RATE_DECAY_S: f64 = 1.0;

/// The rate that follows from the commands.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CommandedRotation {
    /// \[rad/s, body\].
    rate: Vector3<f64>,
}

impl CommandedRotation {
    /// Rotation over an interval \[s\] by the commands in `tracker` \[rad, body axes\]. `seen` is the attitude measured at its beginning,
    /// from which an attitude loop on board turns.
    pub(super) fn turn(
        &mut self,
        tracker: &MotionTracker,
        seen: &Attitude,
        (from_s, to_s): (f64, f64),
    ) -> Vector3<f64> {
        let (mut turn, mut t_s) = (Vector3::zeros(), from_s);
        while t_s < to_s {
            let (input, until_s) = tracker.acting(t_s);
            let dt_s = until_s.min(to_s) - t_s;
            let (aim, lag_s) = match tracker.model().rotation {
                Rotation::RateLoop { lag_s } => (input.demand, lag_s),
                Rotation::AttitudeLoop { gain_per_s, greatest_rate, lag_s } => {
                    let left = seen.rotation_to(&input.attitude) * gain_per_s;
                    (left.zip_map(&greatest_rate, |rate, limit| rate.clamp(-limit, limit)), lag_s)
                }
                Rotation::RigidBody { .. } => (input.demand * RATE_DECAY_S, RATE_DECAY_S),
            };
            let decay = (-dt_s / lag_s).exp();
            turn += aim * dt_s + (self.rate - aim) * (lag_s * (1.0 - decay));
            self.rate = aim + (self.rate - aim) * decay;
            t_s += dt_s;
        }
        turn
    }
}
