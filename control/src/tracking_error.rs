//! The tracking error of attitude and rate, and its time derivatives. Eqs. (8) to (12), (36) to (40).
//!
//! Terms used here and in every law:
//!
//! | symbol | name | what it is |
//! |---|---|---|
//! | `q_e = [eps, lambda]` | [`AttitudeError`] | rotation from the desired axes to the body axes, `q_d^-1 (x) q` |
//! | `eps` | [`AttitudeError::eps`] | axis times the sine of half the error angle; half the angle when small |
//! | `lambda` | [`AttitudeError::lambda`] | cosine of half the error angle, 0..1 |
//! | `C` | [`AttitudeError::rotation`] | takes desired-body components to body components |
//! | `omega_e` | [`AttitudeError::rate_error`] | body rate relative to the desired rate \[rad/s, body axes\] |

use nalgebra::{Matrix3, Vector3};

use crate::quantity::{AngularAcceleration, BodyRate};
use crate::quaternion::Attitude;

/// Attitude and rate of the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeState {
    /// Orientation, body to world.
    pub attitude: Attitude,
    /// `omega` \[rad/s, body axes\].
    pub rate: BodyRate,
}

impl AttitudeState {
    /// Whether every number is finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.attitude.is_finite() && is_finite(&self.rate.0)
    }
}

/// Desired attitude, rate and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeReference {
    /// Desired orientation, desired body to world.
    pub attitude: Attitude,
    /// `omega_d` \[rad/s, desired-body axes\].
    pub rate: BodyRate,
    /// Time derivative of `omega_d` \[rad/s^2, desired-body axes\].
    pub acceleration: AngularAcceleration,
}

impl AttitudeReference {
    /// A reference at rest.
    pub fn at_rest(attitude: Attitude) -> Self {
        Self { attitude, ..Self::default() }
    }

    /// Whether every number is finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.attitude.is_finite() && is_finite(&self.rate.0) && is_finite(&self.acceleration.0)
    }
}

#[inline]
fn is_finite(vector: &Vector3<f64>) -> bool {
    vector.iter().all(|component| component.is_finite())
}

/// The attitude error `q_e = [eps, lambda]` of Eq. (12), the short way round: `lambda >= 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeError {
    eps: Vector3<f64>,
    lambda: f64,
}

impl AttitudeError {
    /// The error of a body at `actual` that should be at `desired`.
    ///
    /// `q` and `-q` are one attitude, so of the two signs of `q_e` the one whose first non-zero
    /// number of `[lambda, eps]` is positive is taken. This rule is unambiguous even at 180 degrees, where `lambda =
    /// 0`.
    #[inline]
    pub fn between(desired: &Attitude, actual: &Attitude) -> Self {
        // Eqs. (8), (9), (10), erratum E-10
        let q_e = (desired.unit_quaternion().inverse() * actual.unit_quaternion()).into_inner();
        let numbers = [q_e.w, q_e.i, q_e.j, q_e.k];
        let negative =
            numbers.iter().find(|number| **number != 0.0).is_some_and(|first| *first < 0.0);
        // Eqs. (11), (12)
        let sign = if negative { -1.0 } else { 1.0 };
        Self { eps: sign * q_e.imag(), lambda: sign * q_e.w }
    }

    /// `eps`: the axis of the error times the sine of half its angle
    /// \[-, body axes and desired-body axes alike\].
    pub fn eps(&self) -> &Vector3<f64> {
        &self.eps
    }

    /// `lambda`: the cosine of half the error angle, 0..1 \[-\].
    pub fn lambda(&self) -> f64 {
        self.lambda
    }

    /// `C`: takes desired-body components to body components \[-\].
    #[inline]
    pub fn rotation(&self) -> Matrix3<f64> {
        let Self { eps, lambda } = self;
        // Eq. (36), erratum E-36
        Matrix3::from_diagonal_element(lambda * lambda - eps.dot(eps)) + 2.0 * eps * eps.transpose()
            - 2.0 * *lambda * eps.cross_matrix()
    }

    /// `omega_e`: the body rate relative to the desired rate \[rad/s, body axes\].
    #[inline]
    pub fn rate_error(&self, omega: BodyRate, omega_d: BodyRate) -> Vector3<f64> {
        // Eq. (36)
        omega.0 - self.rotation() * omega_d.0
    }

    /// Time derivative of `eps` \[1/s\].
    pub fn eps_dot(&self, omega_e: &Vector3<f64>) -> Vector3<f64> {
        // Eq. (38)
        (self.lambda * omega_e + self.eps.cross(omega_e)) / 2.0
    }

    /// Time derivative of `lambda` \[1/s\].
    pub fn lambda_dot(&self, omega_e: &Vector3<f64>) -> f64 {
        // Eq. (39)
        -self.eps.dot(omega_e) / 2.0
    }

    /// Time derivative of `omega_e` \[rad/s^2, body axes\] that goes with the second derivative of
    /// `eps` \[1/s^2\].
    ///
    /// This identity follows from Eqs. (38) and (39) alone: it holds for every motion and contains no property of the
    /// body. It is not defined at 180 degrees, where `lambda = 0`.
    pub fn omega_e_dot_of_eps(
        &self,
        eps_ddot: &Vector3<f64>,
        omega_e: &Vector3<f64>,
    ) -> Vector3<f64> {
        let Self { eps, lambda } = self;
        let m = Matrix3::from_diagonal_element(*lambda) - eps.cross_matrix()
            + eps * eps.transpose() / *lambda;
        // Eq. (37)
        2.0 * m * (eps_ddot + omega_e.norm_squared() / 4.0 * eps)
    }

    /// The angular acceleration that keeps `omega_e` constant: `C omega_d_dot - omega_e x C omega_d` \[rad/s^2, body
    /// axes\]. Multiplied by the inertia it is the feed-forward torque of the reference.
    pub fn reference_acceleration(
        &self,
        omega_e: &Vector3<f64>,
        reference: &AttitudeReference,
    ) -> AngularAcceleration {
        let c = self.rotation();
        AngularAcceleration(c * reference.acceleration.0 - omega_e.cross(&(c * reference.rate.0)))
    }

    /// Time derivative of `omega_e` \[rad/s^2, body axes\] of a body that accelerates by
    /// `omega_dot`, which for a rigid body is
    /// [`Inertia::acceleration`](crate::rigid_body::Inertia::acceleration).
    pub fn omega_e_dot(
        &self,
        omega_dot: AngularAcceleration,
        omega_e: &Vector3<f64>,
        reference: &AttitudeReference,
    ) -> Vector3<f64> {
        // Eq. (40), erratum E-40
        omega_dot.0 - self.reference_acceleration(omega_e, reference).0
    }

    /// The Lyapunov function of the attitude error \[-\]: 0 without error, 2 at 180 degrees. Under `omega_e = -eps`
    /// it decreases at the rate `eps'eps`, Eqs. (49) to (52).
    pub fn lyapunov(&self) -> f64 {
        // Eq. (52); lambda is not negative here
        2.0 * (1.0 - self.lambda)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn attitude() -> impl Strategy<Value = Attitude> {
        prop::array::uniform3(-3.0..3.0_f64)
            .prop_map(|v| Attitude::from_rotation_vector(Vector3::from(v)))
    }

    proptest! {
        #[test]
        fn the_lyapunov_function_falls_at_the_square_of_eps(
            desired in attitude(),
            actual in attitude(),
        ) {
            let error = AttitudeError::between(&desired, &actual);
            let omega_e = -error.eps();
            // Eqs. (49) to (52): lambda is not negative here, so V_dot = -2 lambda_dot
            let v_dot = -2.0 * error.lambda_dot(&omega_e);
            prop_assert!((v_dot + error.eps().norm_squared()).abs() < 1e-15);
            prop_assert!((0.0..=2.0).contains(&error.lyapunov()));
        }

        #[test]
        fn the_error_is_the_turn_from_desired_to_actual(
            desired in attitude(),
            actual in attitude(),
        ) {
            let error = AttitudeError::between(&desired, &actual);
            let half = desired.angle_to(&actual) / 2.0;
            prop_assert!((error.lambda() - half.cos()).abs() < 1e-12);
            prop_assert!((error.eps().norm() - half.sin()).abs() < 1e-12);
            let v = Vector3::new(0.3, -0.5, 0.8);
            let c_v = actual.to_body(&desired.to_world(&v));
            prop_assert!((error.rotation() * v - c_v).amax() < 1e-12);
        }
    }

    #[test]
    fn a_body_at_its_reference_has_no_error() {
        let error = AttitudeError::between(&Attitude::LEVEL, &Attitude::LEVEL);
        // Eq. (11)
        assert_eq!((*error.eps(), error.lambda(), error.lyapunov()), (Vector3::zeros(), 1.0, 0.0));
    }
}
