//! The checks every Riccati problem passes first.

use nalgebra::{Cholesky, Const, SMatrix};

use super::RiccatiError;

/// How far from symmetric, and how far below zero, a weight may be, relative to its own diagonal.
const TOLERANCE: f64 = 1e-10;

/// The weights of a valid problem, symmetrised.
pub(super) struct Weights<const N: usize, const M: usize> {
    pub(super) q: SMatrix<f64, N, N>,
    pub(super) r: SMatrix<f64, M, M>,
    /// `R = LL'`.
    pub(super) r_factor: Cholesky<f64, Const<M>>,
}

impl<const N: usize, const M: usize> Weights<N, M> {
    /// Checks `q` and `r`.
    pub(super) fn new(
        q: &SMatrix<f64, N, N>,
        r: &SMatrix<f64, M, M>,
    ) -> Result<Self, RiccatiError> {
        if !is_finite(q) || !is_finite(r) {
            return Err(RiccatiError::NotFinite);
        }
        let q = symmetric(q).ok_or(RiccatiError::QNotSymmetric)?;
        let r = symmetric(r).ok_or(RiccatiError::RNotSymmetric)?;
        if !is_positive_semidefinite(&q) {
            return Err(RiccatiError::QNotPositiveSemidefinite);
        }
        let r_factor = Cholesky::new(r).ok_or(RiccatiError::RNotPositiveDefinite)?;
        Ok(Self { q, r, r_factor })
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

fn symmetric<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let asymmetry = (matrix - matrix.transpose()).amax();
    (asymmetry <= TOLERANCE * matrix.amax()).then(|| symmetrised(matrix))
}

/// Whether the matrix, brought to unit diagonal so that units do not matter, has a Cholesky factor after a shift by the
/// tolerance.
fn is_positive_semidefinite<const N: usize>(matrix: &SMatrix<f64, N, N>) -> bool {
    let scale: [f64; N] = std::array::from_fn(|i| matrix[(i, i)].sqrt());
    if scale.iter().any(|s| s.is_nan()) {
        return false;
    }
    let unit = SMatrix::<f64, N, N>::from_fn(|i, j| match (i == j, scale[i] * scale[j]) {
        (true, _) => 1.0 + TOLERANCE,
        (false, s) if s > 0.0 => matrix[(i, j)] / s,
        (false, _) => {
            if matrix[(i, j)] == 0.0 {
                0.0
            } else {
                f64::INFINITY
            }
        }
    });
    Cholesky::new(unit).is_some()
}
