//! Riccati solutions against an independent prototype (scipy, refined to 50 digits).

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Complex, SMatrix};
use oqtal_control::riccati::{RiccatiError, Solution, care, dare};
use serde_json::Value;

type Solver<const N: usize> = fn(
    &SMatrix<f64, N, N>,
    &SMatrix<f64, N, 3>,
    &SMatrix<f64, N, N>,
    &SMatrix<f64, 3, 3>,
) -> Result<Solution<N, 3>, RiccatiError>;

fn cases(file: &str) -> Vec<Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(file);
    let text = std::fs::read_to_string(path).expect("golden data are in the tree");
    let mut data: BTreeMap<String, Value> =
        serde_json::from_str(&text).expect("golden data are JSON");
    serde_json::from_value(data.remove("cases").expect("golden data hold cases"))
        .expect("cases are a list")
}

fn list(case: &Value, key: &str) -> Vec<f64> {
    serde_json::from_value(case[key].clone()).expect("a list of numbers")
}

fn matrix<const R: usize, const C: usize>(case: &Value, key: &str) -> SMatrix<f64, R, C> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(case[key].clone()).expect("rows of numbers");
    SMatrix::from_row_iterator(rows.into_iter().flatten())
}

/// Greatest difference between the sums of the k-th powers of the closed-loop eigenvalues and of the golden ones, k = 1 to
/// N, each relative to the largest term. By Newton's identities the sums determine the eigenvalues; unlike those they do not
/// lose half their digits where two eigenvalues meet.
fn eigenvalue_error<const N: usize>(closed_loop: SMatrix<f64, N, N>, case: &Value) -> f64 {
    let golden = list(case, "eig_re").into_iter().zip(list(case, "eig_im"));
    let golden: Vec<Complex<f64>> = golden.map(|(re, im)| Complex::new(re, im)).collect();
    let size = golden.iter().map(|z| z.norm()).fold(0.0, f64::max);
    let mut power = SMatrix::<f64, N, N>::identity();
    let mut worst = 0.0_f64;
    for k in 1..=N as i32 {
        power *= closed_loop / size;
        let expected: f64 = golden.iter().map(|z| (z / size).powi(k).re).sum();
        worst = worst.max((power.trace() - expected).abs());
    }
    worst
}

fn agree<const N: usize>(case: &Value, solver: Solver<N>, [a, b]: [&str; 2], eigenvalues: f64) {
    let name = &case["name"];
    let (a, b) = (matrix(case, a), matrix(case, b));
    let solution = solver(&a, &b, &matrix(case, "Q"), &matrix(case, "R"))
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    let (p, k) = (matrix::<N, N>(case, "P"), matrix::<3, N>(case, "K"));
    let tolerance = if case["cond_P"].as_f64().is_some_and(|c| c > 1e12) {
        1e-7
    } else {
        1e-9
    };
    let errors = [
        (solution.p - p).norm() / p.norm(),
        (solution.k - k).norm() / k.norm(),
    ];
    assert!(
        errors.iter().all(|e| *e <= tolerance),
        "{name}: relative errors of P and K {errors:?}"
    );
    let error = eigenvalue_error(a - b * solution.k, case);
    assert!(
        error <= eigenvalues,
        "{name}: relative error of the closed-loop eigenvalues {error:e}"
    );
}

#[test]
fn continuous_solutions_agree_with_the_prototype() {
    for case in cases("care.json") {
        match case["n"].as_u64() {
            Some(6) => agree::<6>(&case, care, ["A", "B"], 1e-7),
            Some(9) => agree::<9>(&case, care, ["A", "B"], 1e-7),
            n => panic!("no test for {n:?} states"),
        }
    }
}

#[test]
fn discrete_solutions_agree_with_the_prototype() {
    for case in cases("dare.json") {
        match matrix_rows(&case) {
            6 => agree::<6>(&case, dare, ["Ad", "Bd"], 1e-7),
            9 => agree::<9>(&case, dare, ["Ad", "Bd"], 1e-7),
            n => panic!("no test for {n} states"),
        }
    }
}

fn matrix_rows(case: &Value) -> usize {
    case["Ad"].as_array().expect("a list").len()
}
