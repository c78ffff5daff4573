//! Units for the states in which the data of a Riccati problem are of one size.

use nalgebra::SMatrix;

/// Sweeps over the states. Two to four settle most problems, and an unsettled balance is only a less good one.
const SWEEPS: usize = 12;
/// A state whose rows and columns of `[A -G; -Q -A']` agree to within this factor, squared, is left as it is.
const AGREEMENT: f64 = 4.0;

/// A diagonal change of state `x = Dz`. Its elements are powers of two, so scaling rounds nothing.
pub(super) struct Balance<const N: usize> {
    d: [f64; N],
    inverse: [f64; N],
}

impl<const N: usize> Balance<N> {
    /// Equalises row and column sums of `[A -G; -Q -A']` by Osborne's method, restricted to the scalings `diag(D, D^-1)`
    /// that keep its structure.
    pub(super) fn new(
        a: &SMatrix<f64, N, N>,
        g: &SMatrix<f64, N, N>,
        q: &SMatrix<f64, N, N>,
    ) -> Self {
        let (mut a, g, q) = (a.abs(), g.abs(), q.abs());
        a.fill_diagonal(0.0);
        let a_transposed = a.transpose();
        let mut balance = Self { d: [1.0; N], inverse: [1.0; N] };
        for _ in 0..SWEEPS {
            let mut settled = true;
            for i in 0..N {
                let (mut column, mut row) = (0.0, 0.0);
                for j in 0..N {
                    column += a[(j, i)] * balance.inverse[j] + q[(j, i)] * balance.d[j];
                    row += a_transposed[(j, i)] * balance.d[j] + g[(j, i)] * balance.inverse[j];
                }
                let ratio = (row * balance.inverse[i]) / (column * balance.d[i]);
                // Not true of NaN and the infinities, where there is nothing to balance against.
                if ratio > AGREEMENT && ratio < f64::INFINITY
                    || ratio < 1.0 / AGREEMENT && ratio > 0.0
                {
                    let factor = power_of_two(ratio.sqrt());
                    balance.d[i] *= factor;
                    balance.inverse[i] /= factor;
                    settled = false;
                }
            }
            if settled {
                break;
            }
        }
        balance
    }

    /// `D^-1 a D`: the dynamics in balanced units.
    pub(super) fn dynamics(&self, a: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| a[(i, j)] * self.inverse[i] * self.d[j])
    }

    /// `D^-1 b`: the input matrix in balanced units.
    pub(super) fn input<const M: usize>(&self, b: &SMatrix<f64, N, M>) -> SMatrix<f64, N, M> {
        SMatrix::from_fn(|i, j| b[(i, j)] * self.inverse[i])
    }

    /// `D^-1 g D^-1`: `G` in balanced units, or `P` back from them.
    pub(super) fn input_form(&self, g: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| g[(i, j)] * self.inverse[i] * self.inverse[j])
    }

    /// `D q D`: the weight of the states in balanced units.
    pub(super) fn form(&self, q: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|i, j| q[(i, j)] * self.d[i] * self.d[j])
    }

    /// `k D^-1`: a gain back in the units of the caller.
    pub(super) fn gain<const M: usize>(&self, k: &SMatrix<f64, M, N>) -> SMatrix<f64, M, N> {
        SMatrix::from_fn(|i, j| k[(i, j)] * self.inverse[j])
    }
}

/// The power of two nearest to `x > 0` on a logarithmic scale.
fn power_of_two(x: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    f64::from_bits((x * std::f64::consts::SQRT_2).to_bits() & EXPONENT)
}
