//! The continuous-time equation.

use nalgebra::SMatrix;

use super::balance::Balance;
use super::doubling::Doubling;
use super::lu::Lu;
use super::newton::{Stein, refine};
use super::weights::{Weights, is_finite, symmetrised};
use super::{RiccatiError, Solution};

/// Solves `A'P + PA - PBR^-1B'P + Q = 0`; `K = R^-1B'P`.
///
/// `dx/dt = Ax + Bu` under `u = -Kx` is stable and minimises the integral of `x'Qx + u'Ru`.
///
/// # Errors
/// See [`RiccatiError`]. `Q` must be symmetric positive semidefinite and `R` symmetric positive definite.
pub fn care<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    if !is_finite(a) || !is_finite(b) {
        return Err(RiccatiError::NotFinite);
    }
    let weights = Weights::new(q, r)?;
    let k_of_b = weights.r_factor.solve(&b.transpose());
    let g = symmetrised(&(b * k_of_b));
    let balance = Balance::new(a, &g, &weights.q);
    let (a, q) = (balance.map(a), balance.form(&weights.q));
    let g = balance.input(&balance.input(&g).transpose());

    let (pole, start) = cayley(&a, &g, &q).ok_or(RiccatiError::NoStabilisingSolution)?;
    let start = start.cost_to_go().ok_or(RiccatiError::NoStabilisingSolution)?;
    let p = refine(start, |p| {
        let pg = p * g;
        let residual = symmetrised(&(p.tr_mul(&a) * 2.0 - pg * p)) + q;
        // X = S'XS + W has the solution of A_c'X + XA_c + residual = 0.
        let inverse =
            Lu::new(a - pg.transpose() - SMatrix::identity() * pole)?.solve(SMatrix::identity());
        Some(Stein {
            s: SMatrix::identity() + inverse * (2.0 * pole),
            w: inverse.tr_mul(&(residual * inverse)) * (2.0 * pole),
        })
    })?;
    let p = balance.form_back(&p);
    Ok(Solution { p, k: k_of_b * p })
}

/// The discrete problem with the same solution, by the map `(s + pole) / (s - pole)` of the closed-loop poles.
fn cayley<const N: usize>(
    a: &SMatrix<f64, N, N>,
    g: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
) -> Option<(f64, Doubling<N>)> {
    let size = a.norm() + g.norm() + q.norm();
    // |det(H - small)|^(1/2N): the geometric mean of the closed-loop poles.
    let (lu, _, w) = shifted(a, g, q, 1e-3 * size)?;
    let mut pole = ((lu.log2_determinant() + w.log2_determinant()) / (2.0 * N as f64)).exp2();
    for _ in 0..8 {
        if let Some((lu, g_shifted, w)) = shifted(a, g, q, pole)
            && lu.pivot_ratio() > 1e-6
            && w.pivot_ratio() > 1e-6
        {
            let inverse = lu.solve(SMatrix::identity());
            // w = A_s' + Q A_s^-1 G
            let w_inverse = w.solve(SMatrix::identity());
            let e = SMatrix::identity() + w_inverse.transpose() * (2.0 * pole);
            let g = symmetrised(&(g_shifted * w_inverse)) * (2.0 * pole);
            let h = symmetrised(&(w_inverse * (q * inverse))) * (2.0 * pole);
            return Some((pole, Doubling { e, g, h }));
        }
        pole *= 1.5;
    }
    None
}

/// With `A_s = A - pole I`: its factors, `A_s^-1 G`, and the factors of `A_s' + Q A_s^-1 G`.
fn shifted<const N: usize>(
    a: &SMatrix<f64, N, N>,
    g: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
    pole: f64,
) -> Option<(Lu<N>, SMatrix<f64, N, N>, Lu<N>)> {
    let a = a - SMatrix::identity() * pole;
    let lu = Lu::new(a)?;
    let g = lu.solve(*g);
    let w = Lu::new(a.transpose() + q * g)?;
    Some((lu, g, w))
}
