//! Riccati solutions against an independent prototype (scipy, refined to 50 digits).

use nalgebra::{Complex, DMatrix, SMatrix};
use oqtal_control::linear::discretise;
use oqtal_control::riccati::{RiccatiError, Solution, care, dare};
use serde_json::Value;

type Solver<const N: usize> = fn(
    &SMatrix<f64, N, N>,
    &SMatrix<f64, N, 3>,
    &SMatrix<f64, N, N>,
    &SMatrix<f64, 3, 3>,
) -> Result<Solution<N, 3>, RiccatiError>;

const TOLERANCE: f64 = 1e-9;

fn cases(data: &str) -> Vec<Value> {
    let mut data: Value = serde_json::from_str(data).expect("golden data are JSON");
    serde_json::from_value(data["cases"].take()).expect("golden data hold a list of cases")
}

fn list(case: &Value, key: &str) -> Vec<f64> {
    serde_json::from_value(case[key].clone()).expect("a list of numbers")
}

fn matrix<const R: usize, const C: usize>(case: &Value, key: &str) -> SMatrix<f64, R, C> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(case[key].clone()).expect("rows of numbers");
    SMatrix::from_row_iterator(rows.into_iter().flatten())
}

fn states(case: &Value) -> usize {
    case["A"].as_array().expect("a matrix").len()
}

fn relative_error<const R: usize, const C: usize>(
    found: &SMatrix<f64, R, C>,
    golden: &SMatrix<f64, R, C>,
) -> f64 {
    (found - golden).norm() / golden.norm()
}

/// Every golden eigenvalue is one of a matrix within the tolerance of `closed_loop`, and their sums
/// agree. A direct comparison would be ill-conditioned for double eigenvalues.
fn has_golden_poles<const N: usize>(closed_loop: &SMatrix<f64, N, N>, case: &Value) {
    let name = &case["name"];
    let allowed = TOLERANCE * closed_loop.norm();
    let (re, im) = (list(case, "eig_re"), list(case, "eig_im"));
    let sum: f64 = re.iter().sum();
    assert!((closed_loop.trace() - sum).abs() <= allowed, "{name}: sum of the poles");
    for (re, im) in re.into_iter().zip(im) {
        let shifted = DMatrix::from_fn(N, N, |i, j| {
            let pole = if i == j { Complex::new(re, im) } else { Complex::default() };
            pole - closed_loop[(i, j)]
        });
        let distance = shifted.singular_values().min();
        assert!(distance <= allowed, "{name}: {re} + {im}i is off by {distance:e}");
    }
}

fn agrees<const N: usize>(case: &Value, solver: Solver<N>, [a, b]: [&str; 2]) {
    let name = &case["name"];
    let (a, b) = (matrix(case, a), matrix(case, b));
    let solution = solver(&a, &b, &matrix(case, "Q"), &matrix(case, "R"))
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let ill_conditioned = case["cond_P"].as_f64().is_some_and(|condition| condition > 1e12);
    let tolerance = if ill_conditioned { 1e-7 } else { TOLERANCE };
    let p = relative_error(&solution.p, &matrix(case, "P"));
    let k = relative_error(&solution.k, &matrix(case, "K"));
    assert!(p <= tolerance && k <= tolerance, "{name}: P is off by {p:e}, K by {k:e}");
    has_golden_poles(&(a - b * solution.k), case);
}

fn samples<const N: usize>(case: &Value) {
    let h = case["h"].as_f64().expect("a sampling interval");
    let (a, b) = discretise(&matrix::<N, N>(case, "A"), &matrix::<N, 3>(case, "B"), h);
    let a = relative_error(&a, &matrix(case, "Ad"));
    let b = relative_error(&b, &matrix(case, "Bd"));
    assert!(a <= 1e-14 && b <= 1e-14, "{}: Ad is off by {a:e}, Bd by {b:e}", case["name"]);
}

#[test]
fn continuous_solutions_agree_with_the_prototype() {
    let cases = cases(include_str!("golden/care.json"));
    assert_eq!(cases.len(), 28);
    for case in cases {
        match states(&case) {
            6 => agrees::<6>(&case, care, ["A", "B"]),
            9 => agrees::<9>(&case, care, ["A", "B"]),
            n => panic!("no test for {n} states"),
        }
    }
}

#[test]
fn discrete_solutions_agree_with_the_prototype() {
    let cases = cases(include_str!("golden/dare.json"));
    assert_eq!(cases.len(), 4);
    for case in cases {
        match states(&case) {
            6 => agrees::<6>(&case, dare, ["Ad", "Bd"]),
            9 => agrees::<9>(&case, dare, ["Ad", "Bd"]),
            n => panic!("no test for {n} states"),
        }
    }
}

#[test]
fn sampled_systems_agree_with_the_prototype() {
    for case in cases(include_str!("golden/dare.json")) {
        match states(&case) {
            6 => samples::<6>(&case),
            9 => samples::<9>(&case),
            n => panic!("no test for {n} states"),
        }
    }
}
