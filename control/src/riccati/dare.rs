//! The discrete-time equation.

use nalgebra::{Cholesky, SMatrix};

use super::balance::Balance;
use super::doubling::Doubling;
use super::newton::{Stein, refine};
use super::weights::{Weights, is_finite, symmetrised};
use super::{RiccatiError, Solution};

/// Solves `P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q`; `K = (R + B'PB)^-1 B'PA`.
///
/// `x+ = Ax + Bu` under `u = -Kx` is stable and minimises the sum of `x'Qx + u'Ru`.
///
/// # Errors
/// See [`RiccatiError`]. `Q` must be symmetric positive semidefinite and `R` symmetric positive definite.
pub fn dare<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    if !is_finite(a) || !is_finite(b) {
        return Err(RiccatiError::NotFinite);
    }
    let weights = Weights::new(q, r)?;
    let g = b * weights.r_factor.solve(&b.transpose());
    let balance = Balance::new(a, &g, &weights.q);
    let (a, b, q) = (balance.map(a), balance.input(b), balance.form(&weights.q));
    let start =
        Doubling { e: a, g: symmetrised(&balance.input(&balance.input(&g).transpose())), h: q };
    let start = start.cost_to_go().ok_or(RiccatiError::NoStabilisingSolution)?;

    let gain = |p: &SMatrix<f64, N, N>| {
        let pb = p * b;
        let total = weights.r + b.tr_mul(&pb);
        Some(Cholesky::new(total)?.solve(&pb.tr_mul(&a)))
    };
    let p = refine(start, |p| {
        let s = a - b * gain(p)?;
        let w = q - p + a.tr_mul(&(p * s));
        Some(Stein { s, w: symmetrised(&w) })
    })?;
    let k = gain(&p).ok_or(RiccatiError::IllConditioned)?;
    Ok(Solution { p: balance.form_back(&p), k: balance.gain_back(&k) })
}
