//! Kinematics, dynamics and every linear model against an independent implementation (numpy and
//! scipy), to 1e-12.
//!
//! The data are in `golden/kinematics.json`; `golden/generate.py` computes them without code of this project.

use nalgebra::{Matrix3, Quaternion, SMatrix, UnitQuaternion, Vector3, Vector4};
use oqtal_control::error_model::{ErrorModel, Jacobian, OperatingPoint};
use oqtal_control::euler::EulerAngles;
use oqtal_control::quantity::{AngularAcceleration, BodyRate, Torque};
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::{Inertia, quaternion_rate};
use oqtal_control::tracking_error::{AttitudeError, AttitudeReference};
use serde::Deserialize;

const TOLERANCE: f64 = 1e-12;

const JACOBIANS: [Jacobian; 5] = [
    Jacobian::Decoupled,
    Jacobian::Printed45,
    Jacobian::Printed75,
    Jacobian::ExactConstantLambda,
    Jacobian::Exact,
];

type Triple = [f64; 3];
type Square = [[f64; 3]; 3];

#[derive(Deserialize)]
struct Golden {
    samples: Vec<Sample>,
    dynamics: Vec<Dynamics>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sample {
    euler_phi_theta_psi: Triple,
    q: [f64; 4],
    q_eq6_literal: [f64; 4],
    #[serde(rename = "R16")]
    r16: Square,
    #[serde(rename = "Hinv")]
    h_inverse: Square,
    euler_des: Triple,
    q_des: [f64; 4],
    q_e_raw: [f64; 4],
    q_e: [f64; 4],
    #[serde(rename = "C_BB")]
    c: Square,
    omega: Triple,
    omega_d: Triple,
    omega_e: Triple,
    q_dot: [f64; 4],
    euler_rates: Triple,
    eps_dot: Triple,
    lambda_dot: f64,
    omega_e_dot: Triple,
    eps_ddot: Triple,
    jac: Option<Jacobians>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Jacobians {
    eps: Triple,
    lam: f64,
    omega_e: Triple,
    eps_ddot_used: Triple,
    #[serde(rename = "A_w_eps_exact_lambda_const")]
    omega_eps_exact_constant_lambda: Square,
    #[serde(rename = "A_w_eps_exact_lambda_of_eps")]
    omega_eps_exact: Square,
    #[serde(rename = "A_w_eps_printed45")]
    omega_eps_printed_45: Square,
    #[serde(rename = "A_w_eps_printed75")]
    omega_eps_printed_75: Square,
    #[serde(rename = "A_w_w_exact")]
    omega_omega_exact: Square,
    #[serde(rename = "A_w_w_printed46_79")]
    omega_omega_printed: Square,
    #[serde(rename = "A_epsdot_eps_lambda_const")]
    eps_eps_constant_lambda: Square,
    #[serde(rename = "A_epsdot_eps_lambda_of_eps")]
    eps_eps: Square,
    #[serde(rename = "A_epsdot_w")]
    eps_omega: Square,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Dynamics {
    #[serde(rename = "J")]
    j: Square,
    q: [f64; 4],
    q_des: [f64; 4],
    omega: Triple,
    omega_d: Triple,
    omega_d_dot: Triple,
    tau: Triple,
    omega_dot: Triple,
    q_e: [f64; 4],
    omega_e: Triple,
    omega_e_dot: Triple,
}

fn golden() -> Golden {
    let golden: Golden = serde_json::from_str(include_str!("golden/kinematics.json")).unwrap();
    assert_eq!((golden.samples.len(), golden.dynamics.len()), (43, 8));
    assert_eq!(golden.samples.iter().filter(|sample| sample.jac.is_some()).count(), 37);
    golden
}

fn assert_close<const R: usize, const C: usize>(
    ours: &SMatrix<f64, R, C>,
    golden: &SMatrix<f64, R, C>,
    what: &str,
) {
    let difference = (ours - golden).amax();
    assert!(difference <= TOLERANCE, "{what} is off by {difference:e}: {ours} instead of {golden}");
}

fn vector(numbers: Triple) -> Vector3<f64> {
    Vector3::from(numbers)
}

fn matrix(rows: Square) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

/// The attitude of exactly these numbers: rounding a norm once more would show at this tolerance.
fn attitude([x, y, z, w]: [f64; 4]) -> Attitude {
    Attitude::from_unit_quaternion(UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)))
}

/// Both signs of `q_e` are the same error; this crate takes the one with `lambda >= 0`.
fn assert_error_close(ours: &AttitudeError, golden: [f64; 4]) {
    let golden = Vector4::from(golden) * golden[3].signum();
    assert_close(&ours.eps().push(ours.lambda()), &golden, "Eq. (9)");
}

#[test]
fn euler_angles_become_the_golden_quaternion() {
    for sample in golden().samples {
        let theta = EulerAngles::from_vector(&vector(sample.euler_phi_theta_psi));
        assert_close(&Vector4::from(theta.xyzw()), &Vector4::from(sample.q), "Eq. (6)");
        let theta_d = EulerAngles::from_vector(&vector(sample.euler_des));
        assert_close(&Vector4::from(theta_d.xyzw()), &Vector4::from(sample.q_des), "Eq. (6)");
    }
}

/// E-06: the printed equation is the corrected one with roll and pitch exchanged.
#[test]
fn the_printed_quaternion_of_euler_angles_has_roll_and_pitch_exchanged() {
    for sample in golden().samples {
        let [roll, pitch, yaw] = sample.euler_phi_theta_psi;
        let exchanged = EulerAngles { roll: pitch, pitch: roll, yaw };
        assert_close(
            &Vector4::from(exchanged.xyzw()),
            &Vector4::from(sample.q_eq6_literal),
            "Eq. (6) as printed",
        );
    }
}

#[test]
fn rotation_and_rate_matrices_agree_with_golden() {
    for sample in golden().samples {
        let theta = EulerAngles::from_vector(&vector(sample.euler_phi_theta_psi));
        assert_close(&theta.rotation(), &matrix(sample.r16), "Eq. (16)");
        assert_close(&theta.rate_matrix(), &matrix(sample.h_inverse), "Eq. (2)");
        assert_close(
            &theta.rates(BodyRate(vector(sample.omega))).0,
            &vector(sample.euler_rates),
            "Eq. (1)",
        );
    }
}

#[test]
fn euler_angles_of_an_attitude_give_the_golden_rotation() {
    for sample in golden().samples {
        let attitude = attitude(sample.q);
        let rotation = attitude.unit_quaternion().to_rotation_matrix().transpose();
        assert_close(rotation.matrix(), &matrix(sample.r16), "Eqs. (5) and (16)");
        assert_close(
            &EulerAngles::from_attitude(&attitude).rotation(),
            &matrix(sample.r16),
            "Eq. (16)",
        );
    }
}

#[test]
fn quaternion_rate_agrees_with_golden() {
    for sample in golden().samples {
        let rate = quaternion_rate(&attitude(sample.q), BodyRate(vector(sample.omega)));
        assert_close(&rate, &Vector4::from(sample.q_dot), "Eq. (7)");
    }
}

#[test]
fn attitude_error_agrees_with_golden() {
    for sample in golden().samples {
        let error = AttitudeError::between(&attitude(sample.q_des), &attitude(sample.q));
        assert_error_close(&error, sample.q_e);
        assert_error_close(&error, sample.q_e_raw);
        assert_close(&error.rotation(), &matrix(sample.c), "Eq. (36), C");
        let omega_e =
            error.rate_error(BodyRate(vector(sample.omega)), BodyRate(vector(sample.omega_d)));
        assert_close(&omega_e, &vector(sample.omega_e), "Eq. (36), omega_e");
    }
}

#[test]
fn error_kinematics_agree_with_golden() {
    for sample in golden().samples {
        let error = AttitudeError::between(&attitude(sample.q_des), &attitude(sample.q));
        let omega_e = vector(sample.omega_e);
        assert_close(&error.eps_dot(&omega_e), &vector(sample.eps_dot), "Eq. (38)");
        assert!((error.lambda_dot(&omega_e) - sample.lambda_dot).abs() <= TOLERANCE, "Eq. (39)");
        let omega_e_dot = error.omega_e_dot_of_eps(&vector(sample.eps_ddot), &omega_e);
        assert_close(&omega_e_dot, &vector(sample.omega_e_dot), "Eq. (37)");
    }
}

impl Jacobians {
    /// The golden `A_omega_omega`, `A_omega_eps` and `A_eps_eps`.
    fn blocks(&self, jacobian: Jacobian) -> [Matrix3<f64>; 3] {
        let zero = [[0.0; 3]; 3];
        let (constant, varying) = (self.eps_eps_constant_lambda, self.eps_eps);
        let (printed, exact) = (self.omega_omega_printed, self.omega_omega_exact);
        let blocks = match jacobian {
            Jacobian::Decoupled => [zero, zero, varying],
            Jacobian::Printed45 => [printed, self.omega_eps_printed_45, constant],
            Jacobian::Printed75 => [printed, self.omega_eps_printed_75, constant],
            Jacobian::ExactConstantLambda => {
                [exact, self.omega_eps_exact_constant_lambda, constant]
            }
            Jacobian::Exact => [exact, self.omega_eps_exact, varying],
        };
        blocks.map(matrix)
    }
}

#[test]
fn every_jacobian_agrees_with_golden() {
    for jac in golden().samples.iter().filter_map(|sample| sample.jac.as_ref()) {
        let point = OperatingPoint {
            eps: vector(jac.eps),
            lambda: jac.lam,
            omega_e: vector(jac.omega_e),
            eps_ddot: vector(jac.eps_ddot_used),
        };
        for jacobian in JACOBIANS {
            let model = ErrorModel::at(jacobian, &point);
            let [omega_omega, omega_eps, eps_eps] = jac.blocks(jacobian);
            assert_close(&model.omega_omega, &omega_omega, &format!("{jacobian:?}, omega_omega"));
            assert_close(&model.omega_eps, &omega_eps, &format!("{jacobian:?}, omega_eps"));
            assert_close(&model.eps_eps, &eps_eps, &format!("{jacobian:?}, eps_eps"));
            assert_close(&model.eps_omega, &matrix(jac.eps_omega), "Eq. (44)");
        }
    }
}

#[test]
fn an_operating_point_without_acceleration_has_the_lambda_of_its_eps() {
    for jac in golden().samples.iter().filter_map(|sample| sample.jac.as_ref()) {
        let point = OperatingPoint::new(vector(jac.eps), vector(jac.omega_e));
        assert_close(&point.eps, &vector(jac.eps), "eps");
        assert!((point.lambda - jac.lam).abs() <= TOLERANCE);
    }
}

#[test]
fn rigid_body_and_rate_error_dynamics_agree_with_golden() {
    for sample in golden().dynamics {
        let inertia = Inertia::new(matrix(sample.j)).unwrap();
        let omega = BodyRate(vector(sample.omega));
        let reference = AttitudeReference {
            attitude: attitude(sample.q_des),
            rate: BodyRate(vector(sample.omega_d)),
            acceleration: AngularAcceleration(vector(sample.omega_d_dot)),
        };
        let omega_dot = inertia.acceleration(omega, Torque(vector(sample.tau)));
        assert_close(&omega_dot.0, &vector(sample.omega_dot), "Eq. (3)");
        let error = AttitudeError::between(&reference.attitude, &attitude(sample.q));
        assert_error_close(&error, sample.q_e);
        let omega_e = error.rate_error(omega, reference.rate);
        assert_close(&omega_e, &vector(sample.omega_e), "Eq. (36)");
        let omega_e_dot = error.omega_e_dot(omega_dot, &omega_e, &reference);
        assert_close(&omega_e_dot, &vector(sample.omega_e_dot), "Eq. (40)");
    }
}
