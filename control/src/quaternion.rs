//! Attitude as a unit quaternion, Eq. (5): Hamilton product, scalar last, body to world.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Greatest difference from 1 of the norm of a quaternion that is accepted as an attitude \[-\]. Poses in single
/// precision are well within.
pub const NORM_TOLERANCE: f64 = 1e-2;

/// Orientation of the body in the world: the rotation that takes body components to world components.
///
/// `q` and `-q` are one attitude; no result in this crate depends on the sign.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attitude(UnitQuaternion<f64>);

impl Default for Attitude {
    fn default() -> Self {
        Self::LEVEL
    }
}

impl Attitude {
    /// Body axes along world axes.
    pub const LEVEL: Self =
        Self(UnitQuaternion::new_unchecked(Quaternion::new(1.0, 0.0, 0.0, 0.0)));

    /// The attitude `[q1 q2 q3 eta]` of Eq. (5), scalar last, body to world: the only constructor from plain numbers.
    ///
    /// The quaternion is normalised. `None` unless all four are finite and the norm is within [`NORM_TOLERANCE`] of
    /// one.
    pub fn from_xyzw([x, y, z, w]: [f64; 4]) -> Option<Self> {
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        // A comparison with NaN is false, so that numbers that are not finite are refused here too.
        ((norm - 1.0).abs() <= NORM_TOLERANCE)
            .then(|| Self(UnitQuaternion::new_unchecked(quaternion / norm)))
    }

    /// The same attitude as a nalgebra rotation, body to world.
    #[inline]
    pub fn from_unit_quaternion(body_to_world: UnitQuaternion<f64>) -> Self {
        Self(body_to_world)
    }

    /// The attitude reached from level by the rotation vector (axis times angle) \[rad\].
    pub fn from_rotation_vector(rotation: Vector3<f64>) -> Self {
        Self(UnitQuaternion::from_scaled_axis(rotation))
    }

    /// The attitude of a body whose rotation matrix, body to world, is `matrix`.
    pub fn from_rotation_matrix(matrix: &Rotation3<f64>) -> Self {
        Self(UnitQuaternion::from_rotation_matrix(matrix))
    }

    /// `[q1 q2 q3 eta]`, scalar last, body to world \[-\].
    #[inline]
    pub fn xyzw(&self) -> [f64; 4] {
        let q = self.0.quaternion();
        [q.i, q.j, q.k, q.w]
    }

    /// Whether every number is finite. An attitude from [`from_xyzw`](Self::from_xyzw) is; a computed one may not be.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.0.coords.iter().all(|number| number.is_finite())
    }

    /// The nalgebra quaternion, body to world.
    #[inline]
    pub fn unit_quaternion(&self) -> &UnitQuaternion<f64> {
        &self.0
    }

    /// World components of a vector given in body components.
    #[inline]
    pub fn to_world(&self, body: &Vector3<f64>) -> Vector3<f64> {
        self.0 * body
    }

    /// Body components of a vector given in world components.
    #[inline]
    pub fn to_body(&self, world: &Vector3<f64>) -> Vector3<f64> {
        self.0.inverse_transform_vector(world)
    }

    /// The attitude after the body turns by the rotation vector `rotation` \[rad, body axes\]: `q (x) exp(rotation / 2)`.
    pub fn turned_by(&self, rotation: Vector3<f64>) -> Self {
        let mut turned = self.0 * UnitQuaternion::from_scaled_axis(rotation);
        turned.renormalize_fast();
        Self(turned)
    }

    /// The shortest rotation vector from `self` to `other` \[rad, body axes of `self`\]: `other = self.turned_by(v)`.
    pub fn rotation_to(&self, other: &Self) -> Vector3<f64> {
        (self.0.inverse() * other.0).scaled_axis()
    }

    /// Angle between the body's z axis and the vertical, 0..pi \[rad\].
    pub fn tilt_rad(&self) -> f64 {
        self.to_world(&Vector3::z()).angle(&Vector3::z())
    }

    /// The attitude, turned towards the vertical the short way until it is tilted by at most `limit_rad` \[rad\].
    pub fn within_tilt(&self, limit_rad: f64) -> Self {
        let excess_rad = self.tilt_rad() - limit_rad;
        let axis = self.to_world(&Vector3::z()).cross(&Vector3::z()).try_normalize(1e-9);
        match axis {
            Some(axis) if excess_rad > 0.0 => {
                Self(UnitQuaternion::from_scaled_axis(axis * excess_rad) * self.0)
            }
            _ => *self,
        }
    }

    /// The angle between two attitudes, 0..pi \[rad\].
    pub fn angle_to(&self, other: &Self) -> f64 {
        self.0.angle_to(&other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilt_is_limited_in_its_direction_and_a_smaller_one_is_kept() {
        let tilted = Attitude::from_rotation_vector(Vector3::new(0.3, -1.7, 0.4));
        let limited = tilted.within_tilt(0.2);
        let [before, after] = [tilted, limited].map(|attitude| attitude.to_world(&Vector3::z()));
        assert!((limited.tilt_rad() - 0.2).abs() < 1e-12);
        assert!(before.xy().normalize().dot(&after.xy().normalize()) > 1.0 - 1e-12);
        assert_eq!(limited.within_tilt(0.21), limited);
        let over = Attitude::from_rotation_vector(Vector3::x() * std::f64::consts::PI);
        assert!(over.within_tilt(0.2).is_finite());
    }
}
