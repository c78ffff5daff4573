//! Scenes: poses of a body as functions of time, without a plant.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use oqtal_wire::motion::RigidPose;

/// Height of every scene \[m\].
const HEIGHT_M: f64 = 1.0;
/// Radius of the circle, and half the length of the lemniscate \[m\].
const RADIUS_M: f64 = 1.0;
/// Duration of one round \[s\].
const ROUND_S: f64 = 8.0;
/// Greatest bank angle in a moving scene \[rad\].
const BANK_RAD: f64 = 0.15;

/// A motion of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum SceneName {
    /// At rest, level.
    Hover,
    /// Circle, nose forward.
    Circle,
    /// Figure of eight, nose forward.
    Lemniscate,
}

impl SceneName {
    /// Pose of the body after `t_s` seconds.
    pub fn pose(self, t_s: f64) -> RigidPose {
        let angle = TAU * t_s / ROUND_S;
        let (sin, cos) = angle.sin_cos();
        let (position, velocity, bank) = match self {
            Self::Hover => (Vector3::zeros(), Vector3::x(), 0.0),
            Self::Circle => {
                (Vector3::new(cos, sin, 0.0) * RADIUS_M, Vector3::new(-sin, cos, 0.0), -BANK_RAD)
            }
            Self::Lemniscate => (
                Vector3::new(sin, sin * cos, 0.0) * RADIUS_M,
                Vector3::new(cos, (2.0 * angle).cos(), 0.0),
                BANK_RAD * sin,
            ),
        };
        let yaw = velocity.y.atan2(velocity.x);
        let attitude = UnitQuaternion::from_euler_angles(bank, 0.0, yaw);
        let position_m = position + Vector3::z() * HEIGHT_M;
        RigidPose { position_m: position_m.into(), attitude: attitude.coords.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_body_faces_its_direction_of_motion() {
        for scene in [SceneName::Circle, SceneName::Lemniscate] {
            for step in 0..100 {
                let (t, dt) = (f64::from(step) * 0.08, 1e-4);
                let (here, soon) = (scene.pose(t), scene.pose(t + dt));
                let moved = Vector3::from(soon.position_m) - Vector3::from(here.position_m);
                let nose = Vector3::from(here.transformed([1.0, 0.0, 0.0]))
                    - Vector3::from(here.position_m);
                assert!(nose.dot(&moved.normalize()) > 0.999, "{scene:?} at {t}");
            }
        }
        assert_eq!(SceneName::Hover.pose(0.0), SceneName::Hover.pose(3.0));
    }
}
