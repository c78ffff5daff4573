//! One Riccati solve, at the operating points of the laws. Read the figures as ratios within one run.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, SMatrix};
use oqtal_control::riccati::{care, dare};

/// `[omega_e; eps; eps_I]` at the zero cell for a full inertia, the first `N` states of it.
fn error_model<const N: usize>() -> (SMatrix<f64, N, N>, SMatrix<f64, N, 3>) {
    let inertia = Matrix3::new(0.6, 0.05, -0.02, 0.05, 0.5, 0.03, -0.02, 0.03, 0.7);
    let inverse = inertia.try_inverse().expect("an inertia is regular");
    let (mut a, mut b) = (SMatrix::zeros(), SMatrix::zeros());
    for i in 0..3 {
        a[(3 + i, i)] = 0.5;
        if N == 9 {
            a[(6 + i, 3 + i)] = -1.0;
        }
        for j in 0..3 {
            b[(i, j)] = inverse[(i, j)];
        }
    }
    (a, b)
}

fn solves(criterion: &mut Criterion) {
    let r = Matrix3::identity();
    let q3 = Matrix3::identity() * 80.0;
    criterion.bench_function("care, 3 states", |bencher| {
        bencher.iter(|| care(&Matrix3::zeros(), black_box(&Matrix3::identity()), &q3, &r));
    });
    let (a6, b6) = error_model::<6>();
    let q6 = SMatrix::<f64, 6, 6>::identity() * 256.0;
    criterion.bench_function("care, 6 states", |bencher| {
        bencher.iter(|| care(black_box(&a6), &b6, &q6, &r));
    });
    let (a9, b9) = error_model::<9>();
    let mut q9 = SMatrix::<f64, 9, 9>::identity() * 256.0;
    for i in 6..9 {
        q9[(i, i)] *= 0.01;
    }
    criterion.bench_function("care, 9 states", |bencher| {
        bencher.iter(|| care(black_box(&a9), &b9, &q9, &r));
    });
    let (ad, bd) = (SMatrix::identity() + a6 / 60.0, b6 / 60.0);
    criterion.bench_function("dare, 6 states", |bencher| {
        bencher.iter(|| dare(black_box(&ad), &bd, &q6, &r));
    });
}

criterion_group!(benches, solves);
criterion_main!(benches);
