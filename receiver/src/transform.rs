//! Transforms poses from the axes of a camera system to those of the world, and from the frame of the markers to that of the body.

use nalgebra::{UnitQuaternion, Vector3};
use oqtal_config::{ReceiverOptions, UpAxis};
use oqtal_wire::motion::RigidPose;

/// The fixed transforms on both sides of a measured pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseTransform {
    /// Rotation from the room to the world.
    room: UnitQuaternion<f64>,
    /// Origin of the room \[m, world\].
    room_origin: Vector3<f64>,
    /// Rotation from the body to the frame of the markers.
    body: UnitQuaternion<f64>,
    /// Origin of the body \[m, frame of the markers\].
    body_origin: Vector3<f64>,
}

impl PoseTransform {
    /// The transforms of `[receiver]`.
    pub fn new(options: &ReceiverOptions) -> Self {
        let upright = match options.up_axis {
            UpAxis::Z => UnitQuaternion::identity(),
            // y up becomes z up: the axis that pointed to the viewer points to -y.
            UpAxis::Y => UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0),
        };
        // If y is up in the room, it is also up in the frames of the bodies, which are aligned with the room when they are created.
        Self {
            room: rotation(options.room_rotation_deg) * upright,
            room_origin: options.room_position_m.into(),
            body: upright.inverse() * rotation(options.body_rotation_deg),
            body_origin: upright.inverse() * Vector3::from(options.body_position_m),
        }
    }

    /// Position \[m, world\] and attitude \[body to world\] of the body whose markers have the pose `measured`.
    pub fn apply(&self, measured: &RigidPose) -> ([f64; 3], [f64; 4]) {
        let markers = measured.rotation();
        let in_room = Vector3::from(measured.position_m) + markers * self.body_origin;
        let position = self.room_origin + self.room * in_room;
        let attitude = self.room * markers * self.body;
        (position.into(), attitude.coords.into())
    }
}

/// Roll, pitch and yaw, about the fixed axes x, y and z in this order.
fn rotation(roll_pitch_yaw_deg: [f64; 3]) -> UnitQuaternion<f64> {
    let [roll, pitch, yaw] = roll_pitch_yaw_deg.map(f64::to_radians);
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

#[cfg(test)]
mod tests {
    use oqtal_config::Config;

    use super::*;

    fn near(a: &[f64], b: &[f64]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn nothing_changes_by_default() {
        let pose = RigidPose::new([1.0, -2.0, 0.5], [0.1, 0.2, -0.3, 0.9]).unwrap();
        let (position, attitude) = PoseTransform::new(&Config::default().receiver).apply(&pose);
        assert!(near(&position, &pose.position_m) && near(&attitude, &pose.attitude));
    }

    #[test]
    fn a_room_with_y_up_stands_upright() {
        let options = ReceiverOptions { up_axis: UpAxis::Y, ..Config::default().receiver };
        let transform = PoseTransform::new(&options);
        // A vehicle 2 m up, 1 m towards the viewer, turned about the vertical of the room.
        let half = 20_f64.to_radians();
        let pose = RigidPose::new([0.3, 2.0, 1.0], [0.0, half.sin(), 0.0, half.cos()]).unwrap();
        let (position, [x, y, z, w]) = transform.apply(&pose);
        assert!(near(&position, &[0.3, -1.0, 2.0]), "{position:?}");
        let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, 40_f64.to_radians());
        let attitude = RigidPose { attitude: [x, y, z, w], ..pose }.rotation();
        assert!(attitude.angle_to(&turned) < 1e-9, "{attitude}");
    }

    #[test]
    fn room_and_body_are_turned_and_moved() {
        let options = ReceiverOptions {
            room_position_m: [10.0, 0.0, 0.0],
            room_rotation_deg: [0.0, 0.0, 90.0],
            body_position_m: [0.0, 0.0, -0.1],
            body_rotation_deg: [0.0, 0.0, -90.0],
            ..Config::default().receiver
        };
        let transform = PoseTransform::new(&options);
        let pose = RigidPose::new([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]).unwrap();
        let (position, attitude) = transform.apply(&pose);
        assert!(near(&position, &[8.0, 1.0, 2.9]), "{position:?}");
        assert!(near(&attitude, &[0.0, 0.0, 0.0, 1.0]), "{attitude:?}");
    }
}
