//! The structure-preserving doubling algorithm.

use nalgebra::SMatrix;

use super::lu::Lu;
use super::weights::symmetrised;

/// A closed loop that 2^26 steps do not bring to rest counts as not stable.
pub(super) const MAX_DOUBLINGS: usize = 26;

/// Relative size of the last term; convergence is quadratic, so the error left behind is about its square.
const LAST_TERM: f64 = 1e-7;

/// The discrete problem `x+ = e x + ..`, input `g = B R^-1 B'`, cost `h = Q`.
pub(super) struct Doubling<const N: usize> {
    pub(super) e: SMatrix<f64, N, N>,
    pub(super) g: SMatrix<f64, N, N>,
    pub(super) h: SMatrix<f64, N, N>,
}

impl<const N: usize> Doubling<N> {
    /// The limit of the cost over 2^k steps: the stabilising `P`, unless the closed loop is unstable in a way that the
    /// cost does not see. `None` if the cost grows without limit.
    pub(super) fn cost_to_go(mut self) -> Option<SMatrix<f64, N, N>> {
        for _ in 0..MAX_DOUBLINGS {
            let lu = Lu::new(SMatrix::identity() + self.g * self.h)?;
            let e = lu.solve(self.e);
            let g = lu.solve(self.g);
            let term = symmetrised(&self.e.tr_mul(&(self.h * e)));
            self.h += term;
            let (last, total) = (term.norm(), self.h.norm());
            if !total.is_finite() {
                return None;
            }
            if last <= LAST_TERM * total {
                return Some(self.h);
            }
            self.g += symmetrised(&(self.e * g * self.e.transpose()));
            self.e *= e;
        }
        None
    }
}
