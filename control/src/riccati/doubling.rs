//! The structure-preserving doubling algorithm.

use nalgebra::SMatrix;

use super::inverse::{inverse, log2_determinant};
use super::problem::{Problem, symmetrised};

/// Limit of doublings: a loop that has not decayed after 2^30 steps counts as unstable. Rounding alone moves a double
/// pole by about as much.
pub(super) const MAX_DOUBLINGS: usize = 30;
/// The norm of the dynamics over 2^k steps at which the cost has converged; the remainder is smaller than the square
/// of this norm.
const AT_REST: f64 = 1e-7;
/// Growth of a mode beyond which the cost observes it through rounding only.
const UNSEEN: f64 = 1e8;
/// Number of values tried for the centre of the Cayley transform.
const MAX_CENTRES: usize = 8;
/// The condition number of `A - centre I` above which the next value is tried.
const MAX_CONDITION: f64 = 1e8;

/// A discrete-time problem over 2^k steps: dynamics `e`, reach of the input `g`, cost `h`.
pub(super) struct Doubling<const N: usize> {
    e: SMatrix<f64, N, N>,
    g: SMatrix<f64, N, N>,
    h: SMatrix<f64, N, N>,
}

impl<const N: usize> Doubling<N> {
    /// The first step of a discrete-time problem, which is the problem itself.
    pub(super) fn of_discrete<const M: usize>(problem: &Problem<N, M>) -> Self {
        Self { e: problem.a, g: problem.g, h: problem.q }
    }

    /// The discrete-time problem with the solution of a continuous-time one, and the `centre > 0`
    /// of the Cayley transform `s -> (s + centre) / (s - centre)` that takes the poles of one to
    /// those of the other. `None` if a closed-loop pole is zero.
    pub(super) fn of_continuous<const M: usize>(problem: &Problem<N, M>) -> Option<(Self, f64)> {
        let Problem { a, g, q, .. } = problem;
        let log_determinant = log2_determinant([[a, g], [q, &-a.transpose()]]);
        let mut centre = (log_determinant / (2 * N) as f64).exp2();
        for _ in 0..MAX_CENTRES {
            if let Some(doubling) = Self::cayley(problem, centre) {
                return Some((doubling, centre));
            }
            centre *= 1.5;
        }
        None
    }

    /// The Cayley transform of a continuous-time problem. `None` if the centre is too close to an
    /// eigenvalue of `A`.
    fn cayley<const M: usize>(problem: &Problem<N, M>, centre: f64) -> Option<Self> {
        let Problem { a, g, q, .. } = problem;
        let shifted = a - SMatrix::identity() * centre;
        let shifted_inverse = inverse(shifted)?;
        if shifted.norm() * shifted_inverse.norm() > MAX_CONDITION {
            return None;
        }
        let ag = shifted_inverse * g;
        let w = inverse(shifted.transpose() + q * ag)?;
        Some(Self {
            e: SMatrix::identity() + w.transpose() * (2.0 * centre),
            g: symmetrised(&(ag * w)) * (2.0 * centre),
            h: symmetrised(&(w * (q * shifted_inverse))) * (2.0 * centre),
        })
    }

    /// The limit of the cost: the stabilising `P`. `None` if the loop does not decay.
    pub(super) fn cost_to_go(mut self) -> Option<SMatrix<f64, N, N>> {
        let limit = UNSEEN * self.e.norm_squared().max(1.0);
        for _ in 0..MAX_DOUBLINGS {
            let inverse = inverse(SMatrix::identity() + self.g * self.h)?;
            let e_transposed = self.e.transpose();
            let e = self.e * inverse;
            let h = self.h * inverse;
            self.g += symmetrised(&(e * self.g * e_transposed));
            self.h += symmetrised(&(e_transposed * (h * self.e)));
            self.e = e * self.e;
            let size = self.e.norm();
            if size <= AT_REST {
                return Some(self.h);
            }
            if size > limit {
                return None;
            }
        }
        None
    }
}
