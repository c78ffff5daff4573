//! A Riccati problem that has passed its checks, in balanced units.

use nalgebra::{Cholesky, SMatrix};

use super::balance::Balance;
use super::error::RiccatiError;

/// Tolerance for the symmetry and the semidefiniteness of a weight, relative to its size \[-\].
const TOLERANCE: f64 = 1e-10;

/// The data of `care` or `dare`, in the units of `balance`.
pub(super) struct Problem<const N: usize, const M: usize> {
    /// System matrix `A` \[units of `balance`\].
    pub(super) a: SMatrix<f64, N, N>,
    /// Input matrix `B` \[units of `balance`\].
    pub(super) b: SMatrix<f64, N, M>,
    /// `G = BR^-1B'` \[units of `balance`\].
    pub(super) g: SMatrix<f64, N, N>,
    /// Weight of the state \[units of `balance`\].
    pub(super) q: SMatrix<f64, N, N>,
    /// Weight of the input \[units of `balance`\].
    pub(super) r: SMatrix<f64, M, M>,
    pub(super) balance: Balance<N>,
}

impl<const N: usize, const M: usize> Problem<N, M> {
    /// Checks and balances the data.
    pub(super) fn new(
        a: &SMatrix<f64, N, N>,
        b: &SMatrix<f64, N, M>,
        q: &SMatrix<f64, N, N>,
        r: &SMatrix<f64, M, M>,
    ) -> Result<Self, RiccatiError> {
        if !(is_finite(a) && is_finite(b) && is_finite(q) && is_finite(r)) {
            return Err(RiccatiError::NotFinite);
        }
        let q = symmetric(q).ok_or(RiccatiError::QNotSymmetric)?;
        if !is_positive_semidefinite(&q) {
            return Err(RiccatiError::QNotPositiveSemidefinite);
        }
        let r = symmetric(r).ok_or(RiccatiError::RNotSymmetric)?;
        let factor = Cholesky::new(r).ok_or(RiccatiError::RNotPositiveDefinite)?;
        let g = symmetrised(&(b * factor.solve(&b.transpose())));
        let balance = Balance::new(a, &g, &q);
        Ok(Self {
            a: balance.dynamics(a),
            b: balance.input(b),
            g: balance.input_form(&g),
            q: balance.form(&q),
            r,
            balance,
        })
    }
}

/// No element is NaN or infinite.
pub(super) fn is_finite<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>) -> bool {
    matrix.iter().all(|x| x.is_finite())
}

/// Mean of the matrix and its transpose.
pub(super) fn symmetrised<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (matrix + matrix.transpose()) * 0.5
}

/// The symmetric part of the matrix; `None` if its asymmetry exceeds rounding.
fn symmetric<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let asymmetry = (matrix - matrix.transpose()).amax();
    (asymmetry <= TOLERANCE * matrix.amax()).then(|| symmetrised(matrix))
}

/// Whether the symmetric matrix, brought to unit diagonal so that units do not matter, has a
/// Cholesky factor after a shift by the tolerance. Diagonal elements within rounding of zero count
/// as that rounding.
fn is_positive_semidefinite<const N: usize>(matrix: &SMatrix<f64, N, N>) -> bool {
    let rounding = f64::EPSILON * N as f64 * matrix.amax();
    let scale: [f64; N] = std::array::from_fn(|i| (matrix[(i, i)] + rounding).sqrt());
    let unit = SMatrix::<f64, N, N>::from_fn(|i, j| {
        let element = matrix[(i, j)];
        if i == j {
            1.0 + TOLERANCE
        } else if element == 0.0 {
            0.0
        } else {
            element / (scale[i] * scale[j])
        }
    });
    scale.iter().all(|s| !s.is_nan()) && Cholesky::new(unit).is_some()
}
