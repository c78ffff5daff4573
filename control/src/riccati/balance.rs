//! Balancing: scales the states so that the data of a Riccati problem are of similar size.

use nalgebra::SMatrix;

/// Sweeps over the states. Two or three suffice for most problems; an unfinished balance costs only accuracy.
const SWEEPS: usize = 8;
/// Sums that agree to within this factor are left as they are.
const AGREEMENT: f64 = 4.0;

/// A diagonal change of state `x = Dz`. Its elements are powers of two, so scaling rounds nothing.
pub(super) struct Balance<const N: usize> {
    d: [f64; N],
    inverse: [f64; N],
}

impl<const N: usize> Balance<N> {
    /// Equalises row and column sums of `[A -G; -Q -A']` by Osborne's method, restricted to the
    /// scalings `diag(D, D^-1)` that keep its structure.
    pub(super) fn new(
        a: &SMatrix<f64, N, N>,
        g: &SMatrix<f64, N, N>,
        q: &SMatrix<f64, N, N>,
    ) -> Self {
        let mut balance = Self { d: [1.0; N], inverse: [1.0; N] };
        for _ in 0..SWEEPS {
            let mut settled = true;
            for i in 0..N {
                let doublings = balance.doublings(a, g, q, i);
                if doublings != 0 {
                    balance.d[i] *= 2.0_f64.powi(doublings);
                    balance.inverse[i] *= 2.0_f64.powi(-doublings);
                    settled = false;
                }
            }
            if settled {
                break;
            }
        }
        balance
    }

    /// Number of doublings of `D_ii`.
    fn doublings(
        &self,
        a: &SMatrix<f64, N, N>,
        g: &SMatrix<f64, N, N>,
        q: &SMatrix<f64, N, N>,
        i: usize,
    ) -> i32 {
        // The diagonal element of Q grows with the square of D_ii, that of G shrinks with it; the other elements grow
        // and shrink with D_ii itself.
        let (d, inverse) = (&self.d, &self.inverse);
        let (q_ii, g_ii) = (q[(i, i)].abs() * d[i], g[(i, i)].abs() * inverse[i]);
        let (mut column, mut row) = (q_ii, g_ii);
        for j in (0..N).filter(|&j| j != i) {
            column += a[(j, i)].abs() * inverse[j] + q[(j, i)].abs() * d[j];
            row += a[(i, j)].abs() * d[j] + g[(j, i)].abs() * inverse[j];
        }
        let ratio = (row * inverse[i]) / (column * d[i]);
        // Without a row or a column there is nothing to balance.
        if !(ratio > 0.0 && ratio.is_finite()) || (1.0 / AGREEMENT..=AGREEMENT).contains(&ratio) {
            return 0;
        }
        // One Newton step on the logarithms.
        (ratio.log2() / (2.0 + q_ii / column + g_ii / row)).round() as i32
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
