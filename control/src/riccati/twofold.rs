//! Matrices held to twice the working precision, for residuals that cancel.

use nalgebra::SMatrix;

/// An unevaluated sum `value + error`, good to about 32 digits.
#[derive(Clone, Copy)]
pub(super) struct Twofold<const R: usize, const C: usize> {
    value: SMatrix<f64, R, C>,
    error: SMatrix<f64, R, C>,
}

impl<const R: usize, const C: usize> From<SMatrix<f64, R, C>> for Twofold<R, C> {
    fn from(value: SMatrix<f64, R, C>) -> Self {
        Self { value, error: SMatrix::zeros() }
    }
}

impl<const R: usize, const C: usize> Twofold<R, C> {
    /// The sum in working precision.
    pub(super) fn rounded(&self) -> SMatrix<f64, R, C> {
        self.value + self.error
    }

    pub(super) fn transpose(&self) -> Twofold<C, R> {
        Twofold { value: self.value.transpose(), error: self.error.transpose() }
    }

    /// `self + x`.
    pub(super) fn plus(mut self, x: &Self) -> Self {
        self.error += x.error;
        for i in 0..R {
            for j in 0..C {
                self.accumulate(i, j, x.value[(i, j)]);
            }
        }
        self
    }

    /// `xy`.
    pub(super) fn product<const K: usize>(x: &Twofold<R, K>, y: &Twofold<K, C>) -> Self {
        Self::from(SMatrix::zeros()).plus_product(x, y)
    }

    /// `self + xy`, the compensated dot product of Ogita, Rump and Oishi (*SIAM J. Sci. Comput.*
    /// 26, 2005).
    pub(super) fn plus_product<const K: usize>(
        mut self,
        x: &Twofold<R, K>,
        y: &Twofold<K, C>,
    ) -> Self {
        self.error += x.value * y.error + x.error * y.value;
        for i in 0..R {
            for j in 0..C {
                for k in 0..K {
                    let (x, y) = (x.value[(i, k)], y.value[(k, j)]);
                    let product = x * y;
                    self.accumulate(i, j, product);
                    self.error[(i, j)] += x.mul_add(y, -product);
                }
            }
        }
        self
    }

    /// Adds `x` to one element; what the sum rounds off goes to the error (Knuth's two-sum).
    fn accumulate(&mut self, i: usize, j: usize, x: f64) {
        let before = self.value[(i, j)];
        let sum = before + x;
        let added = sum - before;
        self.value[(i, j)] = sum;
        self.error[(i, j)] += (before - (sum - added)) + (x - added);
    }
}
