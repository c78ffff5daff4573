//! CMA-ES, the evolution strategy with covariance matrix adaptation, by the equations of N. Hansen, *The CMA Evolution Strategy: A
//! Tutorial*, arXiv:1604.00772 (equation numbers are those of its version of 2023), with active weights.
//!
//! Each generation is drawn from a normal distribution with mean `m` and covariance `sigma^2 C`. Its better half pulls the mean; `C`
//! grows along the steps that succeeded and shrinks along those that failed; `sigma` grows while successive steps of the mean agree
//! and shrinks while they cancel. [`CmaEs::ask`] returns a generation and [`CmaEs::tell`] takes its values, so that a caller may
//! evaluate a generation in parallel; the result depends on the seed and the values alone.
//!
//! The caller may move asked points before it tells them, for example into bounds.

use nalgebra::{DMatrix, DVector};

use crate::random::SplitMix64;

/// Relative standard deviation, with respect to the start, below which a search has converged \[-\].
const CONVERGED: f64 = 1e-10;

/// A search for the minimum of a function.
#[derive(Clone, Debug)]
pub struct CmaEs {
    rates: LearningRates,
    /// Mean `m` of the distribution.
    mean: DVector<f64>,
    /// Step size `sigma`, and its initial value.
    sigma: f64,
    first_sigma: f64,
    covariance: DMatrix<f64>,
    /// Eigenvectors `B` of the covariance, as columns, and square roots `D` of its eigenvalues.
    axes: DMatrix<f64>,
    lengths: DVector<f64>,
    /// Evolution paths `p_sigma` of the step size and `p_c` of the covariance.
    sigma_path: DVector<f64>,
    covariance_path: DVector<f64>,
    generations: i32,
    random: SplitMix64,
}

/// Weights of a generation, best point first, and rates of adaptation, Table 1.
#[derive(Clone, Debug)]
struct LearningRates {
    /// Weights: positive for the better half, with a sum of 1; negative for the rest.
    weights: Vec<f64>,
    /// Variance-effective number of points with positive weights `mu_eff`.
    effective: f64,
    sigma_path: f64,
    damping: f64,
    covariance_path: f64,
    rank_one: f64,
    rank_mu: f64,
    /// Expected length of a standard normal vector.
    normal_length: f64,
}

impl LearningRates {
    fn new(dimensions: usize) -> Self {
        let n = dimensions as f64;
        let points = 4 + (3.0 * n.ln()).floor() as usize;
        let middle = ((points as f64 + 1.0) / 2.0).ln();
        let raw = |rank: usize| middle - (rank as f64).ln();
        let (better, worse): (Vec<f64>, Vec<f64>) = (1..=points).map(raw).partition(|w| *w >= 0.0);
        let sum = |weights: &[f64]| weights.iter().sum::<f64>();
        let effective_of =
            |weights: &[f64]| sum(weights).powi(2) / weights.iter().map(|w| w * w).sum::<f64>();
        let effective = effective_of(&better);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + effective);
        let rank_mu =
            2.0 * (0.25 + effective + 1.0 / effective - 2.0) / ((n + 2.0).powi(2) + effective);
        let rank_mu = rank_mu.min(1.0 - rank_one);
        // Eqs. (50) to (53)
        let negative = (1.0 + rank_one / rank_mu)
            .min(1.0 + 2.0 * effective_of(&worse) / (effective + 2.0))
            .min((1.0 - rank_one - rank_mu) / (n * rank_mu));
        let (sum_better, sum_worse) = (sum(&better), sum(&worse).abs());
        let positive = better.iter().map(|w| w / sum_better);
        let weights = positive.chain(worse.iter().map(|w| negative * w / sum_worse)).collect();
        let sigma_path = (effective + 2.0) / (n + effective + 5.0);
        let excess = (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0);
        Self {
            weights,
            effective,
            sigma_path,
            damping: 1.0 + 2.0 * excess + sigma_path,
            covariance_path: (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n),
            rank_one,
            rank_mu,
            normal_length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}

impl CmaEs {
    /// Search from `start` with the standard deviation `sigma` \[unit of the coordinates\].
    pub fn new(start: &[f64], sigma: f64, seed: u64) -> Self {
        let n = start.len();
        Self {
            rates: LearningRates::new(n),
            mean: DVector::from_column_slice(start),
            sigma,
            first_sigma: sigma,
            covariance: DMatrix::identity(n, n),
            axes: DMatrix::identity(n, n),
            lengths: DVector::repeat(n, 1.0),
            sigma_path: DVector::zeros(n),
            covariance_path: DVector::zeros(n),
            generations: 0,
            random: SplitMix64::new(seed),
        }
    }

    /// Number of points per generation \[-\].
    pub fn points(&self) -> usize {
        self.rates.weights.len()
    }

    /// Draws a generation, Eqs. (38) to (40).
    pub fn ask(&mut self) -> Vec<Vec<f64>> {
        let point = |_| {
            let z = DVector::from_fn(self.mean.len(), |_, _| self.random.normal());
            let step = &self.axes * z.component_mul(&self.lengths);
            (&self.mean + step * self.sigma).data.into()
        };
        (0..self.rates.weights.len()).map(point).collect()
    }

    /// Takes the values of a generation; NaN counts as the worst value.
    pub fn tell(&mut self, points: &[Vec<f64>], values: &[f64]) {
        let value = |index: &usize| match values[*index] {
            nan if nan.is_nan() => f64::INFINITY,
            value => value,
        };
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|a, b| value(a).total_cmp(&value(b)));
        let step =
            |index: usize| (DVector::from_column_slice(&points[index]) - &self.mean) / self.sigma;
        let steps: Vec<DVector<f64>> = order.into_iter().map(step).collect();
        let better = self.rates.weights.iter().zip(&steps).filter(|(weight, _)| **weight >= 0.0);
        let mean_step = better.fold(DVector::zeros(self.mean.len()), |sum, (w, y)| sum + y * *w);
        self.generations += 1;
        self.mean += &mean_step * self.sigma;
        let is_steady = self.adapt_step_size(&mean_step);
        self.adapt_covariance(&steps, &mean_step, is_steady);
        let eigen = self.covariance.clone().symmetric_eigen();
        self.axes = eigen.eigenvectors;
        // Rounding may make an eigenvalue of an almost flat distribution negative.
        self.lengths = eigen.eigenvalues.map(|value| value.max(1e-20).sqrt());
    }

    /// Whether the distribution has shrunk to a point.
    pub fn has_converged(&self) -> bool {
        let widest = self.sigma * self.lengths.max();
        widest.is_nan() || widest < CONVERGED * self.first_sigma
    }

    /// `C^(-1/2) step`
    fn whitened(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.axes * (self.axes.tr_mul(step)).component_div(&self.lengths)
    }

    /// Updates path and step size, Eqs. (43) and (44). Returns `h_sigma`: whether the path is short enough for the covariance to
    /// follow it.
    fn adapt_step_size(&mut self, mean_step: &DVector<f64>) -> bool {
        let LearningRates { effective, sigma_path: rate, damping, normal_length, .. } = self.rates;
        let gain = (rate * (2.0 - rate) * effective).sqrt();
        self.sigma_path = &self.sigma_path * (1.0 - rate) + self.whitened(mean_step) * gain;
        let length = self.sigma_path.norm() / normal_length;
        self.sigma *= (rate / damping * (length - 1.0)).exp();
        let settled = (1.0 - (1.0 - rate).powi(2 * self.generations)).sqrt();
        length / settled < 1.4 + 2.0 / (self.mean.len() as f64 + 1.0)
    }

    /// Updates path and covariance, Eqs. (45) to (47).
    fn adapt_covariance(
        &mut self,
        steps: &[DVector<f64>],
        mean_step: &DVector<f64>,
        is_steady: bool,
    ) {
        let LearningRates { effective, covariance_path: rate, rank_one, rank_mu, .. } = self.rates;
        let gain = if is_steady { (rate * (2.0 - rate) * effective).sqrt() } else { 0.0 };
        let missing = if is_steady { 0.0 } else { rate * (2.0 - rate) };
        self.covariance_path = &self.covariance_path * (1.0 - rate) + mean_step * gain;
        let n = self.mean.len() as f64;
        let sum: f64 = self.rates.weights.iter().sum();
        let kept = 1.0 + rank_one * missing - rank_one - rank_mu * sum;
        let path = &self.covariance_path;
        let mut covariance = &self.covariance * kept + path * path.transpose() * rank_one;
        for (weight, step) in self.rates.weights.iter().zip(steps) {
            let weight = match *weight >= 0.0 {
                true => *weight,
                false => weight * n / self.whitened(step).norm_squared().max(1e-300),
            };
            covariance += step * step.transpose() * (rank_mu * weight);
        }
        self.covariance = covariance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of evaluations until `objective` falls below 1e-9, from 1 in all `dimensions`; the budget if it does not.
    fn evaluations(objective: &dyn Fn(&[f64]) -> f64, dimensions: usize, seed: u64) -> usize {
        const BUDGET: usize = 20_000;
        let mut search = CmaEs::new(&vec![1.0; dimensions], 0.3, seed);
        let mut spent = 0;
        while spent < BUDGET && !search.has_converged() {
            let points = search.ask();
            let values: Vec<f64> = points.iter().map(|point| objective(point)).collect();
            spent += points.len();
            if values.iter().any(|value| *value < 1e-9) {
                return spent;
            }
            search.tell(&points, &values);
        }
        BUDGET
    }

    fn mean(objective: &dyn Fn(&[f64]) -> f64, dimensions: usize) -> f64 {
        let total: usize = (0..10).map(|seed| evaluations(objective, dimensions, seed)).sum();
        total as f64 / 10.0
    }

    #[test]
    fn a_sphere_costs_a_known_number_of_evaluations() {
        let sphere = |x: &[f64]| x.iter().map(|x| x * x).sum();
        for (dimensions, most) in [(2, 400.0), (5, 900.0), (10, 1700.0)] {
            let cost = mean(&sphere, dimensions);
            assert!(cost < most, "{dimensions} dimensions: {cost}");
        }
    }

    #[test]
    fn a_bent_valley_is_followed() {
        let rosenbrock = |x: &[f64]| {
            x.windows(2)
                .map(|x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2))
                .sum::<f64>()
        };
        // The start of the test lies at the minimum of Rosenbrock's function: moved away.
        let moved = |x: &[f64]| rosenbrock(&x.iter().map(|x| x - 2.0).collect::<Vec<_>>());
        assert!(mean(&moved, 2) < 2000.0);
        assert!(mean(&moved, 5) < 8000.0);
    }

    /// An ellipsoid whose axes differ by a factor of 1000, along the coordinates and turned from them.
    #[test]
    fn a_rotation_of_the_coordinates_does_not_matter() {
        let ellipsoid = |x: &DVector<f64>| -> f64 {
            x.iter().enumerate().map(|(k, x)| 1e6_f64.powf(k as f64 / 4.0) * x * x).sum()
        };
        let mut random = SplitMix64::new(5);
        let turn = DMatrix::from_fn(5, 5, |_, _| random.normal()).qr().q();
        let aligned = mean(&|x| ellipsoid(&DVector::from_column_slice(x)), 5);
        let turned = mean(&|x| ellipsoid(&(&turn * DVector::from_column_slice(x))), 5);
        assert!((turned / aligned - 1.0).abs() < 0.2, "{aligned}, {turned}");
        assert!(turned < 4000.0, "{turned}");
    }

    #[test]
    fn values_that_are_not_numbers_do_not_stop_the_search() {
        let half = |x: &[f64]| match x[0] < 0.5 {
            true => f64::NAN,
            false => (x[0] - 0.6).powi(2) + x[1] * x[1],
        };
        assert!(evaluations(&half, 2, 3) < 1000);
    }
}
