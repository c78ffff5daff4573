//! Rotation of a rigid body: inertia, Euler's equation (3) and the quaternion kinematics (7).

use std::fmt;

use nalgebra::{Matrix3, Matrix4, Vector4};

use crate::quantity::{AngularAcceleration, BodyRate, Torque};
use crate::quaternion::Attitude;

/// Tolerance for symmetry and for the triangle inequality of the principal moments, relative to the trace \[-\].
const TOLERANCE: f64 = 1e-9;

/// The inertia `J` of a body about its centre of mass \[kg m^2, body axes\], with its inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    matrix: Matrix3<f64>,
    inverse: Matrix3<f64>,
}

/// Reason why a matrix is not the inertia of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InertiaError {
    /// An element is NaN or infinite.
    NotFinite,
    /// The matrix is not symmetric.
    NotSymmetric,
    /// A principal moment is zero or negative.
    NotPositiveDefinite,
    /// A principal moment exceeds the sum of the other two.
    NotABody,
}

impl fmt::Display for InertiaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "the inertia holds a number that is not finite",
            Self::NotSymmetric => "the inertia is not symmetric",
            Self::NotPositiveDefinite => "the inertia has a principal moment that is not positive",
            Self::NotABody => "a principal moment of the inertia exceeds the sum of the other two",
        })
    }
}

impl std::error::Error for InertiaError {}

impl Inertia {
    /// The inertia of a body \[kg m^2, body axes\].
    ///
    /// # Errors
    /// If no distribution of mass has this inertia; see [`InertiaError`].
    pub fn new(matrix: Matrix3<f64>) -> Result<Self, InertiaError> {
        if !matrix.iter().all(|element| element.is_finite()) {
            return Err(InertiaError::NotFinite);
        }
        let tolerance = TOLERANCE * matrix.trace().abs();
        if (matrix - matrix.transpose()).amax() > tolerance {
            return Err(InertiaError::NotSymmetric);
        }
        let inverse = matrix.cholesky().ok_or(InertiaError::NotPositiveDefinite)?.inverse();
        if 2.0 * matrix.symmetric_eigenvalues().max() > matrix.trace() + tolerance {
            return Err(InertiaError::NotABody);
        }
        Ok(Self { matrix, inverse })
    }

    /// `J` \[kg m^2, body axes\].
    pub fn matrix(&self) -> &Matrix3<f64> {
        &self.matrix
    }

    /// `J^-1` \[1/(kg m^2), body axes\].
    pub fn inverse(&self) -> &Matrix3<f64> {
        &self.inverse
    }

    /// `omega x J omega`: the torque that keeps the body rate constant \[N m, body axes\].
    #[inline]
    pub fn gyroscopic_torque(&self, omega: BodyRate) -> Torque {
        Torque(omega.0.cross(&(self.matrix * omega.0)))
    }

    /// The angular acceleration of the body at rate `omega` under the torque `tau`, by Euler's equation \[rad/s^2,
    /// body axes\].
    pub fn acceleration(&self, omega: BodyRate, tau: Torque) -> AngularAcceleration {
        // Eq. (3), erratum E-03
        AngularAcceleration(self.inverse * (tau.0 - self.gyroscopic_torque(omega).0))
    }
}

/// Time derivative of `[q1 q2 q3 eta]`, scalar last, of a body that turns at `omega = [p, q, r]`
/// \[1/s\].
#[inline]
pub fn quaternion_rate(attitude: &Attitude, omega: BodyRate) -> Vector4<f64> {
    let [p, q, r] = omega.0.into();
    // Eq. (7), erratum E-07
    #[rustfmt::skip]
    let skew = Matrix4::new(
        0.0, r, -q, p,
        -r, 0.0, p, q,
        q, -p, 0.0, r,
        -p, -q, -r, 0.0,
    );
    skew * Vector4::from(attitude.xyzw()) / 2.0
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn only_a_body_has_an_inertia() {
        let diagonal = |x, y, z| Inertia::new(Matrix3::from_diagonal(&Vector3::new(x, y, z)));
        assert!(diagonal(1.0, 2.0, 2.5).is_ok());
        assert!(diagonal(1.0, 2.0, 3.0).is_ok(), "a flat plate");
        assert_eq!(diagonal(1.0, 2.0, 3.1), Err(InertiaError::NotABody));
        assert_eq!(diagonal(1.0, 0.0, 1.0), Err(InertiaError::NotPositiveDefinite));
        assert_eq!(diagonal(-1.0, -1.0, -1.0), Err(InertiaError::NotPositiveDefinite));
        assert_eq!(diagonal(1.0, f64::NAN, 1.0), Err(InertiaError::NotFinite));
        let lopsided = Matrix3::new(1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        assert_eq!(Inertia::new(lopsided), Err(InertiaError::NotSymmetric));
    }

    #[test]
    fn the_gyroscopic_torque_keeps_the_rate_constant() {
        let inertia =
            Inertia::new(Matrix3::new(0.6, 0.05, -0.02, 0.05, 0.5, 0.03, -0.02, 0.03, 0.7))
                .unwrap();
        let omega = BodyRate(Vector3::new(1.0, -2.0, 0.5));
        assert_eq!(
            inertia.acceleration(omega, inertia.gyroscopic_torque(omega)).0,
            Vector3::zeros()
        );
    }
}
