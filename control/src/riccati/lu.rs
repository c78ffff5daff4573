//! Linear solves for a square matrix of any static size.
//!
//! nalgebra's own `lu` needs `DimMin`, which a function generic over `N` can only satisfy with a `where` clause in its
//! signature and in every caller's.

use nalgebra::SMatrix;

/// `PA = LU` with partial pivoting.
pub(super) struct Lu<const N: usize> {
    /// Unit lower triangle below the diagonal; upper triangle above it.
    factors: SMatrix<f64, N, N>,
    /// Row `swaps[i] >= i` took the place of row `i` at step `i`.
    swaps: [usize; N],
    /// Reciprocals of the pivots.
    inverse_pivots: [f64; N],
}

impl<const N: usize> Lu<N> {
    /// `None` if a pivot is zero or not finite.
    pub(super) fn new(mut a: SMatrix<f64, N, N>) -> Option<Self> {
        let mut swaps = [0; N];
        let mut inverse_pivots = [0.0; N];
        for i in 0..N {
            let mut pivot = i;
            for row in i + 1..N {
                if a[(row, i)].abs() > a[(pivot, i)].abs() {
                    pivot = row;
                }
            }
            a.swap_rows(i, pivot);
            swaps[i] = pivot;
            let inverse = 1.0 / a[(i, i)];
            if !inverse.is_finite() {
                return None;
            }
            inverse_pivots[i] = inverse;
            for row in i + 1..N {
                a[(row, i)] *= inverse;
            }
            for column in i + 1..N {
                let factor = a[(i, column)];
                for row in i + 1..N {
                    a[(row, column)] -= a[(row, i)] * factor;
                }
            }
        }
        Some(Self { factors: a, swaps, inverse_pivots })
    }

    /// `A^-1 b`.
    pub(super) fn solve<const K: usize>(&self, mut b: SMatrix<f64, N, K>) -> SMatrix<f64, N, K> {
        for (i, &pivot) in self.swaps.iter().enumerate() {
            b.swap_rows(i, pivot);
        }
        for column in 0..K {
            for i in 0..N {
                let factor = b[(i, column)];
                for row in i + 1..N {
                    b[(row, column)] -= self.factors[(row, i)] * factor;
                }
            }
            for i in (0..N).rev() {
                let factor = b[(i, column)] * self.inverse_pivots[i];
                b[(i, column)] = factor;
                for row in 0..i {
                    b[(row, column)] -= self.factors[(row, i)] * factor;
                }
            }
        }
        b
    }

    /// `log2 |det A|`.
    pub(super) fn log2_determinant(&self) -> f64 {
        -self.inverse_pivots.iter().map(|p| p.abs().log2()).sum::<f64>()
    }

    /// Smallest over largest pivot magnitude: a cheap stand-in for the reciprocal condition number.
    pub(super) fn pivot_ratio(&self) -> f64 {
        let (small, large) =
            self.inverse_pivots.iter().fold((f64::INFINITY, 0.0_f64), |(small, large), p| {
                (small.min(p.abs()), large.max(p.abs()))
            });
        small / large
    }
}
