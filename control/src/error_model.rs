//! Linear model of the attitude error for the design of the regulator: the matrix `A` of Eq. (41).
//!
//! About an operating point the error moves as
//!
//! ```text
//! d [omega_e]   [A_omega_omega  A_omega_eps] [omega_e]   [J^-1]
//! dt[  eps  ] = [ A_eps_omega    A_eps_eps ] [  eps  ] + [ 0  ] tau
//! ```
//!
//! The paper takes the upper blocks from Eq. (37), which is a kinematic identity between `eps` and `omega_e` and not
//! a model of the body, and prints two of the blocks with errors. All versions are available, so that their effect
//! can be tested in flight: see [`Jacobian`].

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

/// Least `lambda` of an operating point \[-\], since the models divide by `lambda`: an error of 169 degrees.
pub const LAMBDA_MIN: f64 = 0.1;

/// Version of the derivatives in `A`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Jacobian {
    /// Model of the body itself: the law cancels `omega x J omega`, so torque alone moves `omega_e` and the upper
    /// blocks are zero. The lower ones are exact. Not in the paper.
    #[default]
    Decoupled,
    /// Eqs. (43) to (46) as printed.
    #[serde(rename = "printed-45")]
    Printed45,
    /// The same with Eqs. (75) and (79) of the paper's appendix.
    #[serde(rename = "printed-75")]
    Printed75,
    /// The correct derivatives of Eqs. (37) and (38), with `lambda` held constant as in the paper.
    ExactConstantLambda,
    /// The correct derivatives of Eqs. (37) and (38), with `lambda` as a function of `eps`.
    Exact,
}

/// The state about which the error is linearised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatingPoint {
    /// `eps` \[-\].
    pub eps: Vector3<f64>,
    /// `lambda` \[-\], positive.
    pub lambda: f64,
    /// `omega_e` \[rad/s, body axes\].
    pub omega_e: Vector3<f64>,
    /// Second time derivative of `eps` \[1/s^2\].
    pub eps_ddot: Vector3<f64>,
}

impl OperatingPoint {
    /// The operating point at `eps` and `omega_e` \[rad/s, body axes\], with `eps_ddot = 0`: the paper neglects `eps_ddot`
    /// (Section VII.C), since it would consist of twice differentiated measurement noise.
    ///
    /// An `eps` with `lambda` below [`LAMBDA_MIN`] is shortened until `lambda` equals it. The corner of a cell may
    /// have a norm above 1, the greatest possible norm of an error.
    pub fn new(eps: Vector3<f64>, omega_e: Vector3<f64>) -> Self {
        let longest = (1.0 - LAMBDA_MIN * LAMBDA_MIN).sqrt();
        let eps = eps.cap_magnitude(longest);
        let lambda = (1.0 - eps.norm_squared()).sqrt().max(LAMBDA_MIN);
        Self { eps, lambda, omega_e, eps_ddot: Vector3::zeros() }
    }
}

/// The four blocks of `A` in Eq. (41) at one operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorModel {
    /// Derivative of `omega_e_dot` with respect to `omega_e` \[1/s\].
    pub omega_omega: Matrix3<f64>,
    /// Derivative of `omega_e_dot` with respect to `eps` \[1/s^2\].
    pub omega_eps: Matrix3<f64>,
    /// Derivative of `eps_dot` with respect to `omega_e` \[-\].
    pub eps_omega: Matrix3<f64>,
    /// Derivative of `eps_dot` with respect to `eps` \[1/s\].
    pub eps_eps: Matrix3<f64>,
}

impl ErrorModel {
    /// The model of the version `jacobian` at `point`.
    pub fn at(jacobian: Jacobian, point: &OperatingPoint) -> Self {
        let zero = Matrix3::zeros();
        let (omega_omega, omega_eps) = match jacobian {
            // Eqs. (45), (46), erratum E-47: an identity of the kinematics, not the plant
            Jacobian::Decoupled => (zero, zero),
            Jacobian::Printed45 => (point.omega_omega_46(), point.omega_eps_45()),
            Jacobian::Printed75 => (point.omega_omega_46(), point.omega_eps_75()),
            Jacobian::ExactConstantLambda => (point.omega_omega(), point.omega_eps()),
            Jacobian::Exact => {
                (point.omega_omega(), point.omega_eps() + point.omega_eps_through_lambda())
            }
        };
        let eps_eps = match jacobian {
            Jacobian::Decoupled | Jacobian::Exact => {
                point.eps_eps() + point.eps_eps_through_lambda()
            }
            Jacobian::Printed45 | Jacobian::Printed75 | Jacobian::ExactConstantLambda => {
                point.eps_eps()
            }
        };
        Self { omega_omega, omega_eps, eps_omega: point.eps_omega(), eps_eps }
    }

    /// `A` for the state `[omega_e; eps]`.
    pub fn state_matrix(&self) -> Matrix6<f64> {
        let mut a = Matrix6::zeros();
        // Eq. (41)
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.omega_omega);
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&self.omega_eps);
        a.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.eps_omega);
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.eps_eps);
        a
    }
}

/// The derivatives, with the paper's letters: `e = eps`, `l = lambda`, `w = omega_e`,
/// `a = eps_ddot`.
impl OperatingPoint {
    /// Derivative of Eq. (38) with respect to `eps`, `lambda` constant.
    fn eps_eps(&self) -> Matrix3<f64> {
        // Eqs. (43), (70)
        -self.omega_e.cross_matrix() / 2.0
    }

    /// Derivative of Eq. (38) with respect to `eps` through `lambda`.
    fn eps_eps_through_lambda(&self) -> Matrix3<f64> {
        // Eq. (43), erratum E-43
        -self.omega_e * self.eps.transpose() / (2.0 * self.lambda)
    }

    /// Derivative of Eq. (38) with respect to `omega_e`.
    fn eps_omega(&self) -> Matrix3<f64> {
        // Eqs. (44), (72)
        (self.eps.cross_matrix() + scaled_identity(self.lambda)) / 2.0
    }

    /// The part of the derivative of Eq. (37) common to all versions:
    /// `a^x + (e a' + e'a I) / l`.
    fn omega_eps_of_acceleration(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, eps_ddot: a, .. } = self;
        a.cross_matrix() + (e * a.transpose() + scaled_identity(e.dot(a))) / *l
    }

    /// Derivative of Eq. (37) with respect to `eps` as printed in the text.
    fn omega_eps_45(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, omega_e: w, .. } = self;
        let (ee, e_e_i) = (e * e.transpose(), scaled_identity(e.norm_squared()));
        // Eq. (45), errata E-45a, E-45b, E-45c, as printed
        2.0 * (self.omega_eps_of_acceleration()
            + w.norm_squared() / 4.0 * (scaled_identity(*l) - 2.0 * e.cross_matrix() + ee / *l)
            + (ee + e_e_i) / *l)
    }

    /// Derivative of Eq. (37) with respect to `eps` as printed in the appendix.
    fn omega_eps_75(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, omega_e: w, .. } = self;
        let (ee, e_e_i) = (e * e.transpose(), scaled_identity(e.norm_squared()));
        // Eq. (75), erratum E-75, as printed
        2.0 * (self.omega_eps_of_acceleration()
            + w.norm_squared() / 4.0
                * (scaled_identity(*l) - 2.0 * e.cross_matrix() + (ee + e_e_i) / *l))
    }

    /// Derivative of Eq. (37) with respect to `eps`, `lambda` constant.
    fn omega_eps(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, omega_e: w, .. } = self;
        let (ee, e_e_i) = (e * e.transpose(), scaled_identity(e.norm_squared()));
        // Eqs. (45) and (75), errata E-45a, E-45b, E-45c, E-75
        2.0 * (self.omega_eps_of_acceleration()
            + w.norm_squared() / 4.0 * (scaled_identity(*l) + (2.0 * ee + e_e_i) / *l))
    }

    /// Derivative of Eq. (37) with respect to `eps` through `lambda`: `2 (-b e' / l + e (e'b) e' / l^3)` with
    /// `b = a + w'w e / 4`.
    fn omega_eps_through_lambda(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, omega_e: w, eps_ddot: a } = self;
        let b = a + w.norm_squared() / 4.0 * e;
        // Eq. (45), erratum E-45d
        2.0 * (e * (e.dot(&b) / l.powi(3)) - b / *l) * e.transpose()
    }

    /// Derivative of Eq. (37) with respect to `omega_e` as printed.
    fn omega_omega_46(&self) -> Matrix3<f64> {
        let Self { eps: e, lambda: l, omega_e: w, .. } = self;
        // Eqs. (46), (79), erratum E-46, as printed; (46) also has -e^x, which e takes to zero
        (scaled_identity(*l) + e * e.transpose() / *l) * e / 2.0 * w.transpose()
    }

    /// Derivative of Eq. (37) with respect to `omega_e`.
    fn omega_omega(&self) -> Matrix3<f64> {
        // Eqs. (46), (79), erratum E-46
        2.0 * self.omega_omega_46()
    }
}

fn scaled_identity(scale: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(scale)
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, UnitQuaternion, Vector6};
    use proptest::prelude::*;

    use super::*;
    use crate::quaternion::Attitude;
    use crate::tracking_error::AttitudeError;

    fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
    }

    /// `[omega_e_dot; eps_dot]` by Eqs. (37) and (38) at `[omega_e; eps]`.
    fn rates(x: &Vector6<f64>, eps_ddot: &Vector3<f64>) -> Vector6<f64> {
        let (omega_e, eps) = (x.fixed_rows::<3>(0).into(), Vector3::from(x.fixed_rows::<3>(3)));
        let lambda = (1.0 - eps.norm_squared()).sqrt();
        let q_e = UnitQuaternion::new_normalize(nalgebra::Quaternion::from_parts(lambda, eps));
        let error = AttitudeError::between(&Attitude::LEVEL, &Attitude::from_unit_quaternion(q_e));
        let mut rates = Vector6::zeros();
        rates.fixed_rows_mut::<3>(0).copy_from(&error.omega_e_dot_of_eps(eps_ddot, &omega_e));
        rates.fixed_rows_mut::<3>(3).copy_from(&error.eps_dot(&omega_e));
        rates
    }

    proptest! {
        #[test]
        fn the_exact_model_is_the_derivative_of_the_error_kinematics(
            eps in vector(0.5),
            omega_e in vector(2.0),
            eps_ddot in vector(1.0),
        ) {
            let x = Vector6::from_iterator(omega_e.iter().chain(&eps).copied());
            let step = 1e-5;
            let difference =
                SMatrix::<f64, 6, 6>::from_columns(&std::array::from_fn::<_, 6, _>(|i| {
                    let shift = Vector6::ith(i, step);
                    (rates(&(x + shift), &eps_ddot) - rates(&(x - shift), &eps_ddot)) / (2.0 * step)
                }));
            let point = OperatingPoint {
                eps_ddot,
                ..OperatingPoint::new(eps, omega_e)
            };
            let model = ErrorModel::at(Jacobian::Exact, &point).state_matrix();
            prop_assert!((model - difference).amax() < 1e-6);
        }

        #[test]
        fn an_operating_point_is_an_error_short_of_half_a_turn(eps in vector(3.0)) {
            let point = OperatingPoint::new(eps, Vector3::zeros());
            prop_assert!(point.lambda >= LAMBDA_MIN);
            prop_assert!((point.eps.norm_squared() + point.lambda.powi(2) - 1.0).abs() < 1e-12);
            prop_assert!(point.eps.cross(&eps).norm() < 1e-12);
        }
    }
}
