//! Random systems for the tests of the Riccati solvers.

use nalgebra::SMatrix;
use proptest::prelude::*;

/// `A`, `B`, `Q` and `R`.
pub type System<const N: usize, const M: usize> =
    (SMatrix<f64, N, N>, SMatrix<f64, N, M>, SMatrix<f64, N, N>, SMatrix<f64, M, M>);

pub fn any_matrix<const R: usize, const C: usize>() -> impl Strategy<Value = SMatrix<f64, R, C>> {
    prop::collection::vec(-1.0..1.0_f64, R * C).prop_map(SMatrix::from_vec)
}

/// A symmetric matrix with eigenvalues from 0.1 upwards.
pub fn any_weight<const N: usize>() -> impl Strategy<Value = SMatrix<f64, N, N>> {
    any_matrix::<N, N>().prop_map(|c| c.transpose() * c + SMatrix::identity() * 0.1)
}

/// Random dynamics, stable or not.
pub fn any_system<const N: usize, const M: usize>() -> impl Strategy<Value = System<N, M>> {
    (any_matrix(), any_matrix(), any_weight(), any_weight())
        .prop_map(|(a, b, q, r)| (a, b + SMatrix::identity(), q, r))
}

/// A system of each size that the solvers are tested with.
pub type SystemsOfAllSizes = (
    System<1, 1>,
    System<2, 1>,
    System<3, 3>,
    System<4, 2>,
    System<6, 3>,
    System<9, 3>,
    System<12, 4>,
);

pub fn systems_of_all_sizes() -> impl Strategy<Value = SystemsOfAllSizes> {
    (
        any_system(),
        any_system(),
        any_system(),
        any_system(),
        any_system(),
        any_system(),
        any_system(),
    )
}
