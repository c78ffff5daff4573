//! Units for the states in which the data of a Riccati problem are of one size.

use nalgebra::SMatrix;

/// Sweeps over the states; two or three settle most problems.
const SWEEPS: usize = 12;

/// A diagonal change of state `x = Dz`, powers of two, so that scaling rounds nothing.
pub(super) struct Balance<const N: usize>([f64; N]);

impl<const N: usize> Balance<N> {
    /// Equalises row and column sums of `[A -G; -Q -A']` as Osborne's method does (*J. ACM* 7, 1960), restricted to the
    /// scalings `diag(D, D^-1)` that keep the Riccati structure.
    pub(super) fn new(
        a: &SMatrix<f64, N, N>,
        g: &SMatrix<f64, N, N>,
        q: &SMatrix<f64, N, N>,
    ) -> Self {
        let (a, g, q) = (a.abs(), g.abs(), q.abs());
        let mut d = [1.0; N];
        for _ in 0..SWEEPS {
            let mut settled = true;
            for i in 0..N {
                let (mut grows, mut shrinks) = (q[(i, i)] * d[i] * d[i], g[(i, i)] / (d[i] * d[i]));
                for j in (0..N).filter(|&j| j != i) {
                    grows += d[i] * (a[(j, i)] / d[j] + q[(j, i)] * d[j]);
                    shrinks += (a[(i, j)] * d[j] + g[(i, j)] / d[j]) / d[i];
                }
                let factor = power_of_two((shrinks / grows).sqrt());
                if factor != 1.0 {
                    d[i] *= factor;
                    settled = false;
                }
            }
            if settled {
                break;
            }
        }
        Self(d)
    }

    /// `D^-1 m D`: `A` in the new units.
    pub(super) fn map(&self, m: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| m[(i, j)] / self.0[i] * self.0[j])
    }

    /// `D^-1 b`: `B` in the new units.
    pub(super) fn input<const M: usize>(&self, b: &SMatrix<f64, N, M>) -> SMatrix<f64, N, M> {
        SMatrix::from_fn(|i, j| b[(i, j)] / self.0[i])
    }

    /// `D q D`: a quadratic form in the new units.
    pub(super) fn form(&self, q: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| q[(i, j)] * self.0[i] * self.0[j])
    }

    /// `D^-1 p D^-1`: a quadratic form back in the old units.
    pub(super) fn form_back(&self, p: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| p[(i, j)] / self.0[i] / self.0[j])
    }

    /// `k D^-1`: a gain back in the old units.
    pub(super) fn gain_back<const M: usize>(&self, k: &SMatrix<f64, M, N>) -> SMatrix<f64, M, N> {
        SMatrix::from_fn(|i, j| k[(i, j)] / self.0[j])
    }
}

/// `x` rounded down to a power of two after multiplication by sqrt 2; 1 where there is nothing to balance against.
fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    let rounded = f64::from_bits((x * std::f64::consts::SQRT_2).to_bits() & EXPONENT);
    if rounded > 0.0 && rounded.is_finite() { rounded } else { 1.0 }
}
