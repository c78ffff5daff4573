//! Newton's method on a Riccati equation: the error left by the start, and the proof that the loop is stable.

use nalgebra::SMatrix;

use super::RiccatiError;
use super::doubling::MAX_DOUBLINGS;
use super::weights::{is_finite, symmetrised};

/// A step this small, relative to `P`, ends the iteration: the error after it is smaller still.
const SETTLED: f64 = 1e-10;
/// A step that no longer shrinks is rounding noise; a solution known no better than this is not returned.
const ACCEPTABLE: f64 = 1e-7;
/// Steps; one is usual.
const MAX_STEPS: usize = 12;
/// A power of the closed loop this small ends the squaring.
const AT_REST: f64 = 1e-4;

/// The linearised equation at `P`, as a Stein equation `X = S'XS + W` for the correction `X` of `P`.
pub(super) struct Stein<const N: usize> {
    pub(super) s: SMatrix<f64, N, N>,
    pub(super) w: SMatrix<f64, N, N>,
}

impl<const N: usize> Stein<N> {
    /// `X = sum S'^i W S^i`, 2^k terms after k squarings. `None` if the powers of `S` do not vanish.
    fn solve(mut self) -> Option<SMatrix<f64, N, N>> {
        for _ in 0..MAX_DOUBLINGS {
            self.w += self.s.tr_mul(&(self.w * self.s));
            self.s *= self.s;
            let rest = self.s.norm();
            if !rest.is_finite() {
                return None;
            }
            if rest <= AT_REST {
                return Some(symmetrised(&self.w));
            }
        }
        None
    }
}

/// Corrects `p` until the correction is small. `linearise` gives the Stein equation at `p`.
pub(super) fn refine<const N: usize>(
    mut p: SMatrix<f64, N, N>,
    linearise: impl Fn(&SMatrix<f64, N, N>) -> Option<Stein<N>>,
) -> Result<SMatrix<f64, N, N>, RiccatiError> {
    let mut previous = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let x = linearise(&p)
            .and_then(Stein::solve)
            .filter(is_finite)
            .ok_or(RiccatiError::NoStabilisingSolution)?;
        p += x;
        let step = x.norm() / p.norm();
        if step <= SETTLED || x.norm() == 0.0 {
            return Ok(p);
        }
        if step <= ACCEPTABLE && step > 0.25 * previous {
            return Ok(p);
        }
        previous = step;
    }
    Err(RiccatiError::IllConditioned)
}
