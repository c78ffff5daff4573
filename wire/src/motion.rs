//! Measurements of a motion-capture system, independent of its protocol: poses of rigid bodies and positions of markers.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Largest deviation from orthonormal columns that a rotation matrix of 32-bit numbers may have \[-\].
const ORTHONORMAL_TOLERANCE: f64 = 1e-3;

/// Pose of a rigid body in the volume of a motion-capture system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidPose {
    /// Position of the body's origin \[m, volume\].
    pub position_m: [f64; 3],
    /// Attitude, a Hamilton quaternion x, y, z, w of norm 1 \[body to volume\].
    pub attitude: [f64; 4],
}

impl RigidPose {
    /// The pose, with a quaternion of norm 1; `None` if a number is not finite or the quaternion is near zero.
    pub fn new(position_m: [f64; 3], attitude: [f64; 4]) -> Option<Self> {
        let norm = attitude.iter().map(|x| x * x).sum::<f64>().sqrt();
        let finite = position_m.iter().chain(&attitude).all(|x| x.is_finite());
        let sound = finite && (0.5..2.0).contains(&norm);
        sound.then(|| Self { position_m, attitude: attitude.map(|x| x / norm) })
    }

    /// The pose of a rotation matrix, column by column; `None` if the matrix is not a rotation.
    pub fn from_columns(position_m: [f64; 3], columns: [f64; 9]) -> Option<Self> {
        let matrix = Matrix3::from_column_slice(&columns);
        let error = (matrix.transpose() * matrix - Matrix3::identity()).amax();
        // Written so that a NaN fails.
        let is_rotation = error <= ORTHONORMAL_TOLERANCE && matrix.determinant() > 0.0;
        if !is_rotation {
            return None;
        }
        let rotation = Rotation3::from_matrix_unchecked(matrix);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        Self::new(position_m, q.coords.into())
    }

    /// Rotation matrix from body to volume, column by column \[-\].
    pub fn columns(&self) -> [f64; 9] {
        let mut columns = [0.0; 9];
        columns.copy_from_slice(self.rotation().to_rotation_matrix().matrix().as_slice());
        columns
    }

    /// Angles a1, a2, a3 with the attitude Rx(a1) Ry(a2) Rz(a3) \[deg\].
    pub fn euler_xyz_deg(&self) -> [f64; 3] {
        let r = self.rotation().to_rotation_matrix();
        let pitch = r[(0, 2)].clamp(-1.0, 1.0).asin();
        let angles = if r[(0, 2)].abs() < 1.0 - 1e-12 {
            [(-r[(1, 2)]).atan2(r[(2, 2)]), pitch, (-r[(0, 1)]).atan2(r[(0, 0)])]
        } else {
            // Only a1 + a3 or a1 - a3 is determined.
            [r[(2, 1)].atan2(r[(1, 1)]), pitch, 0.0]
        };
        angles.map(f64::to_degrees)
    }

    /// The point of the volume that is at `point_m` in body axes \[m, volume\].
    pub fn transformed(&self, point_m: [f64; 3]) -> [f64; 3] {
        let rotation = self.rotation().to_rotation_matrix();
        (rotation * Vector3::from(point_m) + Vector3::from(self.position_m)).into()
    }

    /// The attitude \[body to volume\].
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        let [x, y, z, w] = self.attitude;
        UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
    }
}

/// A rigid body in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySample {
    /// Pose; `None` while the cameras do not see the body.
    pub pose: Option<RigidPose>,
    /// Mean distance of the markers from the body that is fitted to them \[m\].
    pub residual_m: f64,
}

impl BodySample {
    /// A body not seen by the cameras.
    pub const LOST: Self = Self { pose: None, residual_m: 0.0 };
}

/// A marker in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerSample {
    /// Position \[m, volume\]; `None` while the cameras do not see the marker.
    pub position_m: Option<[f64; 3]>,
    /// Mean distance of the cameras' rays from the position \[m\].
    pub residual_m: f64,
}

/// One frame of a motion-capture system.
#[derive(Clone, Copy, Debug)]
pub struct MotionFrame<'a> {
    /// Number of the frame \[-\].
    pub number: u32,
    /// Time of exposure on the server's clock \[ns\].
    pub captured_ns: u64,
    /// Time of transmission on the server's clock \[ns\].
    pub sent_ns: u64,
    /// The rigid bodies, in the order of their definition.
    pub bodies: &'a [BodySample],
    /// The markers, those of the first body first.
    pub markers: &'a [MarkerSample],
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_1_SQRT_2;

    /// A turn of 90 degrees about axis `axis`.
    fn quarter_turn(axis: usize) -> RigidPose {
        let mut attitude = [0.0, 0.0, 0.0, FRAC_1_SQRT_2];
        attitude[axis] = FRAC_1_SQRT_2;
        RigidPose::new([0.0; 3], attitude).unwrap()
    }

    #[test]
    fn a_quarter_turn_about_an_axis_moves_the_next_axis_to_the_one_after() {
        for axis in 0..3 {
            let mut next = [0.0; 3];
            next[(axis + 1) % 3] = 1.0;
            let turned = quarter_turn(axis).transformed(next);
            assert!((turned[(axis + 2) % 3] - 1.0).abs() < 1e-12, "{turned:?}");
            let column = (axis + 1) % 3;
            let matrix = quarter_turn(axis).columns();
            assert!((matrix[3 * column + (axis + 2) % 3] - 1.0).abs() < 1e-12, "{matrix:?}");
        }
    }

    #[test]
    fn a_turn_about_one_axis_is_one_euler_angle() {
        for axis in 0..3 {
            let mut expected = [0.0; 3];
            expected[axis] = 30.0;
            let mut attitude = [0.0, 0.0, 0.0, 15_f64.to_radians().cos()];
            attitude[axis] = 15_f64.to_radians().sin();
            let angles = RigidPose::new([0.0; 3], attitude).unwrap().euler_xyz_deg();
            let error = angles.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-9, "{angles:?}");
        }
    }

    #[test]
    fn a_matrix_that_is_not_a_rotation_is_not_a_pose() {
        let mirror = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
        assert_eq!(RigidPose::from_columns([0.0; 3], mirror), None);
        assert_eq!(RigidPose::from_columns([0.0; 3], [0.5; 9]), None);
        assert_eq!(RigidPose::from_columns([0.0; 3], [f64::NAN; 9]), None);
        assert_eq!(RigidPose::new([0.0; 3], [0.0; 4]), None);
        assert_eq!(RigidPose::new([f64::INFINITY, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), None);
    }

    proptest! {
        #[test]
        fn a_rotation_matrix_has_the_attitude_that_it_was_made_of(
            q in prop::array::uniform4(-1.0..1.0_f64),
        ) {
            prop_assume!(q.iter().map(|x| x * x).sum::<f64>() > 0.3);
            let pose = RigidPose::new([1.0, 2.0, 3.0], q).unwrap();
            let back = RigidPose::from_columns(pose.position_m, pose.columns()).unwrap();
            let product: f64 = back.attitude.iter().zip(pose.attitude).map(|(a, b)| a * b).sum();
            prop_assert!((product.abs() - 1.0).abs() < 1e-9);
            let [a, b, c] = pose.euler_xyz_deg().map(f64::to_radians);
            let euler = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
                * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
                * Rotation3::from_axis_angle(&Vector3::z_axis(), c);
            prop_assert!((euler.matrix() - pose.rotation().to_rotation_matrix().matrix()).amax() < 1e-6);
        }

        #[test]
        fn arbitrary_numbers_are_a_sound_pose_or_none(
            position in prop::array::uniform3(any::<f64>()),
            q in prop::array::uniform4(any::<f64>()),
        ) {
            if let Some(pose) = RigidPose::new(position, q) {
                let norm: f64 = pose.attitude.iter().map(|x| x * x).sum();
                prop_assert!((norm - 1.0).abs() < 1e-9);
            }
        }
    }
}
