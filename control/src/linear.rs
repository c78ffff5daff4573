//! Linear systems under a sampled input.

use nalgebra::SMatrix;

/// Number of terms of the series below \[-\]: with the norm of its argument at most one half, the first omitted term
/// is below a quarter of the rounding unit.
const TERMS: u32 = 14;

/// Discrete-time system `x+ = Ad x + Bd u` with the same states as `dx/dt = Ax + Bu` at the times `0, h, 2h, ..` \[s\] if `u` is
/// held in between (zero-order hold). Returns `(Ad, Bd)`.
///
/// Exact but for rounding: `Ad = exp(Ah)` and `Bd = Psi(Ah) B h` with `Psi(X) = I + X/2! + X^2/3! +
/// ..`, by scaling and squaring (Moler and Van Loan, *SIAM Review* 45, 2003; C. Van Loan, *IEEE
/// TAC* 23, 1978). Results that overflow, or data that are not finite, give numbers that are not
/// finite.
pub fn discretise<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    h: f64,
) -> (SMatrix<f64, N, N>, SMatrix<f64, N, M>) {
    let x = a * h;
    let norm = x.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    // Chosen so that the norm of x / 2^doublings is at most one half. The bound is the range of the exponents of f64.
    let doublings = (norm.log2().ceil() + 1.0).clamp(0.0, 1024.0) as i32;
    let x = x * 0.5_f64.powi(doublings);

    let identity = SMatrix::<f64, N, N>::identity();
    let mut psi = identity;
    for k in (2..=TERMS).rev() {
        psi = identity + x * psi / f64::from(k);
    }
    // exp(x) - I. The identity is left out of the squaring, so that small terms are not rounded off.
    let mut change = x * psi;
    for _ in 0..doublings {
        psi += psi * change * 0.5;
        change = change * 2.0 + change * change;
    }
    (identity + change, psi * b * h)
}
