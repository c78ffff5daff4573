//! The models and gains of the laws against an independent implementation: `golden/care.json`,
//! solved in 50 digits.

use std::collections::HashMap;

use nalgebra::{DMatrix, SVector};
use oqtal_control::controller::{AugmentedModel, ClassicLqr, Gain, LqrOptions, Weights};
use oqtal_control::error_model::{ErrorModel, Jacobian, OperatingPoint};
use serde::Deserialize;

use super::*;

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct Case {
    #[serde(rename = "name")]
    name: String,
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
    q: Vec<Vec<f64>>,
    r: Vec<Vec<f64>>,
    k: Vec<Vec<f64>>,
}

fn golden() -> HashMap<String, Case> {
    let golden: Golden = serde_json::from_str(include_str!("../golden/care.json")).unwrap();
    golden.cases.into_iter().map(|case| (case.name.clone(), case)).collect()
}

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows[0].len(), |row, column| rows[row][column])
}

impl Case {
    fn has_rate(&self) -> bool {
        !self.name.contains("rate")
    }

    fn weights(&self) -> Weights {
        let of = |state: usize| self.q.get(state).map_or(0.0, |row| row[state]);
        let r = self.r[0][0];
        if self.has_rate() {
            Weights { rate: of(0), attitude: of(3), integral: of(6), input: r }
        } else {
            Weights { rate: 0.0, attitude: of(0), integral: of(3), input: r }
        }
    }

    fn inertia(&self) -> Inertia {
        Inertia::new(Matrix3::from_fn(|row, column| self.b[row][column]).try_inverse().unwrap())
            .unwrap()
    }

    fn check(&self, model: &AugmentedModel, gain: &Gain) {
        let (first, n) = (if self.has_rate() { 0 } else { 3 }, self.a.len());
        let compare = |what: &str, ours: DMatrix<f64>, golden: DMatrix<f64>, tolerance: f64| {
            let difference = (&ours - &golden).amax() / golden.amax().max(1.0);
            assert!(
                difference <= tolerance,
                "{} {what}: off by {difference:e}: {ours} instead of {golden}",
                self.name
            );
        };
        compare(
            "A",
            DMatrix::from_fn(n, n, |i, j| model.a[(first + i, first + j)]),
            matrix(&self.a),
            1e-12,
        );
        compare(
            "B",
            DMatrix::from_fn(n, 3, |i, j| model.b[(first + i, j)]),
            matrix(&self.b),
            1e-12,
        );
        compare("K", DMatrix::from_fn(3, n, |i, j| gain[(i, first + j)]), matrix(&self.k), 1e-9);
        let others = (0..9).filter(|column| !(first..first + n).contains(column));
        assert!(
            others.into_iter().all(|column| gain.column(column).amax() == 0.0),
            "{}",
            self.name
        );
    }
}

/// The operating points of the golden cases: zero, "mid" and "large".
fn operating_points() -> [OperatingPoint; 3] {
    let large = OperatingPoint::new(Vector3::new(0.5, 0.4, -0.3), Vector3::new(1.0, -0.8, 0.6));
    [
        OperatingPoint::new(Vector3::zeros(), Vector3::zeros()),
        OperatingPoint::new(Vector3::new(0.2, -0.1, 0.15), Vector3::new(0.3, -0.2, 0.25)),
        OperatingPoint { eps_ddot: Vector3::new(0.1, 0.2, -0.3), ..large },
    ]
}

#[test]
fn oqtal_has_the_golden_models_and_gains() {
    let golden = golden();
    let [zero, middle, large] = operating_points();
    let cases = [
        ("oqtal6_zero_J0.5_q1", Jacobian::Decoupled, zero),
        ("oqtal6_zero_J0.5_q4096", Jacobian::Exact, zero),
        ("oqtal6_decoupled_mid", Jacobian::Decoupled, middle),
        ("oqtal6_decoupled_large_Jfull", Jacobian::Decoupled, large),
        ("oqtal6_printed45_46_large_Jfull", Jacobian::Printed45, large),
        ("oqtal6_printed75_79_mid", Jacobian::Printed75, middle),
        ("oqtal6_exact_lamconst_mid", Jacobian::ExactConstantLambda, middle),
        ("oqtal6_exact_lamconst_large_Jfull", Jacobian::ExactConstantLambda, large),
        ("oqtal6_exact_lamvar_large_Jfull", Jacobian::Exact, large),
        ("oqtal9_int_zero_Jhummingbird_q20", Jacobian::Decoupled, zero),
        ("oqtal9_int_exact_lamvar_Jfull", Jacobian::Exact, middle),
    ];
    for (name, jacobian, point) in cases {
        let case = &golden[name];
        let input = TorqueInput::new(case.inertia(), MAX_TORQUE).unwrap();
        let model = AugmentedModel::new(&ErrorModel::at(jacobian, &point).state_matrix(), &input);
        case.check(&model, &model.gain(&case.weights()).unwrap());
    }
}

/// The rate authority of the golden cases is 2 rad/s.
#[test]
fn oqtal_in_rate_form_has_the_golden_models_and_gains() {
    let golden = golden();
    let cases = [
        ("oqtal_rate6_int_q200_eps0", Vector3::zeros()),
        ("oqtal_rate6_int_q200_eps", Vector3::new(0.1, -0.05, 0.2)),
    ];
    for (name, eps) in cases {
        let model =
            ErrorModel::at(Jacobian::Decoupled, &OperatingPoint::new(eps, Vector3::zeros()));
        let model = AugmentedModel::new(&model.state_matrix(), &sticks());
        golden[name].check(&model, &model.gain(&golden[name].weights()).unwrap());
    }
}

#[test]
fn the_classic_law_has_the_golden_models_and_gains() {
    let golden = golden();
    let options = LqrOptions { operating_pitch_limit_rad: 1.55, ..LqrOptions::spacecraft() };
    let cases = [
        ("classic6_th0.0000_w0_q128", [0.0; 6]),
        ("classic6_th0.2000_w-0.2_q128", [0.0, -0.2, 0.0, 0.2, 0.2, 0.0]),
        ("classic6_th1.4000_w0_q128", [0.0, 0.0, 0.0, 0.0, 1.4, 0.0]),
        ("classic6_th1.5000_w-0.2_q128", [0.2, -0.2, 0.2, 0.2, 1.5, 0.2]),
        ("classic6_th0.6_Jfull_q1_r1", [0.4, -0.2, 0.6, 0.3, 0.6, 0.0]),
        ("classic9_int_th0_q20", [0.5, -0.5, 0.5, -0.2, 0.0, 0.0]),
        ("classic9_int_th1_q200", [0.5, -0.5, 0.5, -0.2, 1.0, 0.0]),
    ];
    for (name, point) in cases {
        let case = &golden[name];
        let input = TorqueInput::new(case.inertia(), MAX_TORQUE).unwrap();
        let a = ClassicLqr::state_matrix(&options, &input, &SVector::from(point));
        let model = AugmentedModel::new(&a, &input);
        case.check(&model, &model.gain(&case.weights()).unwrap());
    }
}
