//! One Riccati solution for each size that the laws use.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use oqtal_control::euler::EulerAngles;
use oqtal_control::linear::discretise;
use oqtal_control::riccati::{RiccatiError, Solution, care, dare};

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const DT_S: f64 = 1.0 / 60.0;

type Solver<const N: usize> = fn(
    &SMatrix<f64, N, N>,
    &SMatrix<f64, N, 3>,
    &SMatrix<f64, N, N>,
    &Matrix3<f64>,
) -> Result<Solution<N, 3>, RiccatiError>;

/// A, B and Q; R is the identity.
type System<const N: usize> = (SMatrix<f64, N, N>, SMatrix<f64, N, 3>, SMatrix<f64, N, N>);

/// `[omega; attitude; integral]`, truncated after `N`: the kinematics `omega -> attitude` and an inertia.
fn system<const N: usize>(
    kinematics: Matrix3<f64>,
    inertia: Vector3<f64>,
    weights: [f64; 3],
) -> System<N> {
    let mut a = SMatrix::<f64, 9, 9>::zeros();
    a.fixed_view_mut::<3, 3>(3, 0).copy_from(&kinematics);
    a.fixed_view_mut::<3, 3>(6, 3).fill_diagonal(-1.0);
    let mut b = SMatrix::<f64, N, 3>::zeros();
    b.fixed_view_mut::<3, 3>(0, 0).set_diagonal(&inertia.map(|j| 1.0 / j));
    let q = SMatrix::from_diagonal(&SVector::from_fn(|i, _| weights[i / 3]));
    (a.fixed_view::<N, N>(0, 0).into_owned(), b, q)
}

fn solve<const N: usize>(
    criterion: &mut Criterion,
    name: &str,
    solver: Solver<N>,
    (a, b, q): System<N>,
) {
    let r = Matrix3::identity();
    assert!(solver(&a, &b, &q, &r).is_ok());
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| solver(black_box(&a), black_box(&b), black_box(&q), black_box(&r)));
    });
}

fn riccati(criterion: &mut Criterion) {
    let half = Matrix3::from_diagonal_element(0.5);
    let tilted = EulerAngles::from_vector(&Vector3::repeat(10.0 * DEGREE)).rate_matrix();
    let spacecraft = Vector3::repeat(0.5);
    let quadrotor = Vector3::new(0.0075, 0.0075, 0.013);
    let weights = [20.0, 20.0, 0.2];

    let rate_input = (SMatrix::zeros(), half, Matrix3::from_diagonal_element(200.0));
    solve::<3>(criterion, "care/3 oqtal", care, rate_input);
    let (a, b, q) = system(half, spacecraft, [256.0; 3]);
    solve::<6>(criterion, "care/6 oqtal", care, (a, b, q));
    solve::<6>(criterion, "care/6 classic", care, system(tilted, spacecraft, [128.0; 3]));
    solve::<9>(criterion, "care/9 oqtal", care, system(half, quadrotor, weights));
    solve::<9>(criterion, "care/9 classic", care, system(tilted, quadrotor, weights));
    let (a, b) = discretise(&a, &b, DT_S);
    solve::<6>(criterion, "dare/6 oqtal", dare, (a, b, q));
}

criterion_group!(benches, riccati);
criterion_main!(benches);
