//! Estimate of the parameters of a model from the innovations of the filter that uses it: the recursive prediction-error method
//! (Ljung and Söderström, *Theory and Practice of Recursive Identification*, 1983).

use nalgebra::{RowSVector, SMatrix, SVector};

/// Time constant with which the uncertainty of a parameter returns to its initial value \[s\].
const MEMORY_S: f64 = 120.0;

/// Innovation above which a pose corrects no parameter \[standard deviations\].
const OUTLIER_SIGMA: f64 = 5.0;

/// Least estimated lag \[s\]: a shorter one decays between two poses and cannot be distinguished from zero.
pub(super) const LEAST_LAG_S: f64 = 10e-3;

/// Parameters with their covariance, within bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ParameterEstimate<const N: usize> {
    nominal: SVector<f64, N>,
    /// Greatest deviations from the nominal values.
    bounds: SVector<f64, N>,
    prior: SMatrix<f64, N, N>,
    value: SVector<f64, N>,
    covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> ParameterEstimate<N> {
    /// The estimate of independent parameters before the first innovation: the bounds are two standard deviations away.
    pub fn new(nominal: SVector<f64, N>, bounds: SVector<f64, N>) -> Self {
        let sd = bounds * 0.5;
        let prior = SMatrix::from_diagonal(&sd.component_mul(&sd));
        Self { nominal, bounds, prior, value: nominal, covariance: prior }
    }

    /// The estimate before the first innovation if `share` \[-\] of the variance of the first `count` parameters is common to them.
    pub fn with_common(mut self, count: usize, share: f64) -> Self {
        let sd = self.bounds * 0.5;
        for (row, column) in (0..count).flat_map(|row| (0..count).map(move |column| (row, column)))
        {
            if row != column {
                self.prior[(row, column)] = share * sd[row] * sd[column];
            }
        }
        self.restarted()
    }

    /// The estimate before the first innovation.
    pub fn restarted(&self) -> Self {
        Self { value: self.nominal, covariance: self.prior, ..*self }
    }

    /// Whether every parameter is known.
    pub fn is_fixed(&self) -> bool {
        self.bounds == SVector::<f64, N>::zeros()
    }

    /// The estimated parameters.
    pub fn value(&self) -> &SVector<f64, N> {
        &self.value
    }

    /// Standard deviations of the estimate.
    pub fn deviations(&self) -> SVector<f64, N> {
        self.covariance.diagonal().map(f64::sqrt)
    }

    /// Corrects the parameters by an innovation `off` with this `variance`, whose sensitivity to them is `slope`; an outlier is ignored.
    pub fn learn(&mut self, (off, variance): (f64, f64), slope: &RowSVector<f64, N>) {
        let spread = self.covariance * slope.transpose();
        let expected = variance + slope.dot(&spread.transpose());
        // A comparison with NaN is false.
        if !(off * off <= OUTLIER_SIGMA * OUTLIER_SIGMA * expected && expected > 0.0) {
            return;
        }
        let gain = spread / expected;
        let off_nominal = self.value + gain * off - self.nominal;
        let within = off_nominal.zip_map(&self.bounds, |off, most| off.clamp(-most, most));
        self.value = self.nominal + within;
        self.covariance -= gain * spread.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }

    /// Raises a parameter to a least value.
    pub fn raise(&mut self, index: usize, least: f64) {
        self.value[index] = self.value[index].max(least);
    }

    /// Lets the uncertainty return to the initial one for `dt_s` \[s\].
    pub fn forget(&mut self, dt_s: f64) {
        let forgotten = (dt_s / MEMORY_S).clamp(0.0, 1.0);
        self.covariance += (self.prior - self.covariance) * forgotten;
    }
}
