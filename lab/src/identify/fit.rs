//! Nonlinear least squares with bounds, and the covariance of the result.

use nalgebra::{DMatrix, DVector};
use rmpfit::{MPConfig, MPFitter, MPPar, MPResult};

use super::finding::INTERVAL;

/// Greatest number of iterations of a fit.
const ITERATIONS: usize = 60;
/// Change of the sum of squares, and of the parameters, at which a fit has converged \[-\].
const TOLERANCE: f64 = 1e-11;

/// Number of fits in a [`precise_fit`], each with steps from the previous one.
const PASSES: usize = 3;

/// A parameter of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitParameter {
    /// Initial value \[unit of the parameter\].
    pub start: f64,
    /// Least and greatest value \[unit of the parameter\].
    pub bounds: [f64; 2],
    /// Step of the numerical derivatives, about the required precision \[unit of the parameter\].
    pub step: f64,
    /// Whether the parameter keeps its initial value.
    pub is_fixed: bool,
}

/// Result of a fit.
#[derive(Clone, Debug)]
pub struct FitResult {
    /// The parameters \[unit of each\].
    pub values: Vec<f64>,
    /// Covariance of the parameters \[product of their units\]; 0 for a fixed parameter.
    pub covariance: DMatrix<f64>,
}

impl FitResult {
    /// Value and standard deviation of a parameter \[its unit\].
    pub fn of(&self, index: usize) -> (f64, f64) {
        (self.values[index], self.covariance[(index, index)].max(0.0).sqrt())
    }
}

struct Problem<'a> {
    parameters: Vec<MPPar>,
    config: MPConfig,
    points: usize,
    residuals: &'a dyn Fn(&[f64]) -> Vec<f64>,
}

impl MPFitter for Problem<'_> {
    fn eval(&mut self, values: &[f64], deviates: &mut [f64]) -> MPResult<()> {
        deviates.copy_from_slice(&(self.residuals)(values));
        Ok(())
    }

    fn number_of_points(&self) -> usize {
        self.points
    }

    fn config(&self) -> &MPConfig {
        &self.config
    }

    fn parameters(&self) -> &[MPPar] {
        &self.parameters
    }
}

/// Values that minimise the sum of the squared `residuals`; `None` if the residuals cannot be computed. Residuals are in standard
/// deviations; their number does not depend on the values.
pub fn least_squares(
    parameters: &[FitParameter],
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Option<Vec<f64>> {
    let mut values: Vec<f64> = parameters.iter().map(FitParameter::inside).collect();
    let config =
        MPConfig { max_iter: ITERATIONS, ftol: TOLERANCE, xtol: TOLERANCE, ..MPConfig::new() };
    let mut problem = Problem {
        parameters: parameters.iter().map(FitParameter::constraint).collect(),
        config,
        points: residuals(&values).len(),
        residuals,
    };
    problem.mpfit(&mut values).ok()?;
    Some(values)
}

/// Steps of a parameter by which two fits differ that ended in different optima \[-\].
const APART_STEPS: f64 = 10.0;
/// Relative decrease of the sum of squares for which another starting point is taken than the own one \[-\].
const BETTER: f64 = 1e-3;

/// Fits from several starting points.
#[derive(Clone, Debug, Default)]
pub struct StartingPoints {
    /// Number of starting points \[-\].
    pub count: usize,
    /// Differences of the parameters of the fits that ended apart from the best, with their sum of squares over that of the best, minus
    /// 1 \[-\]. All fits have the same noise, which a later fit estimates: its values are not comparable with these.
    others: Vec<(Vec<f64>, f64)>,
}

impl StartingPoints {
    /// Number of fits that ended in another optimum, with one of the first `reported` parameters further away than the 95 % interval of
    /// `best`, and the least excess of their sums of squares \[-\].
    pub fn elsewhere(&self, best: &FitResult, reported: usize) -> (usize, f64) {
        let is_outside = |differences: &[f64]| {
            differences.iter().take(reported).enumerate().any(|(index, difference)| {
                let (_, sd) = best.of(index);
                sd > 0.0 && difference.abs() > INTERVAL * sd
            })
        };
        let excesses = self.others.iter().filter(|it| is_outside(&it.0)).map(|it| it.1);
        excesses.fold((0, f64::INFINITY), |(count, least), it| (count + 1, it.min(least)))
    }
}

/// Moves `parameters` to the best optimum that a fit finds from their own initial values and from the other `starts`, which replace
/// the first values. `None` if no fit can be computed.
pub fn move_to_best(
    parameters: &mut [FitParameter],
    starts: &[Vec<f64>],
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Option<StartingPoints> {
    let own: Vec<f64> = parameters.iter().map(|parameter| parameter.start).collect();
    let others = starts.iter().map(|start| [&start[..], &own[start.len()..]].concat());
    let fit = |start: Vec<f64>| {
        let from = parameters.iter().zip(start);
        let from: Vec<_> = from.map(|(p, start)| FitParameter { start, ..*p }).collect();
        let values = least_squares(&from, residuals)?;
        let square: f64 = residuals(&values).iter().map(|residual| residual * residual).sum();
        square.is_finite().then_some((values, square))
    };
    let own_fit = fit(own.clone());
    let fits: Vec<(Vec<f64>, f64)> =
        own_fit.clone().into_iter().chain(others.filter_map(fit)).collect();
    let least = fits.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let own_fit = own_fit.filter(|own| own.1 * (1.0 - BETTER) <= least.1);
    let is_own = own_fit.is_some();
    let best = own_fit.unwrap_or_else(|| least.clone());
    let is_apart = |values: &[f64]| {
        let pairs = parameters.iter().zip(values).zip(&best.0);
        pairs.into_iter().any(|((p, a), b)| !p.is_fixed && (a - b).abs() > APART_STEPS * p.step)
    };
    let count = fits.len();
    let others = fits.into_iter().filter(|(values, _)| is_apart(values));
    let others = others.map(|(values, square)| {
        let pairs = values.iter().zip(&best.0);
        (pairs.map(|(value, best)| value - best).collect(), square / best.1 - 1.0)
    });
    let others = others.collect();
    // The fit that follows starts from the own initial values, if they lead to the best optimum.
    if !is_own {
        parameters.iter_mut().zip(best.0).for_each(|(parameter, start)| parameter.start = start);
    }
    Some(StartingPoints { count, others })
}

/// Step of a derivative over the standard deviation of its parameter \[-\].
const STEP_SHARE: f64 = 0.5;

/// Result of a fit that starts at the initial values of `parameters`. The fit is repeated with derivative steps that match the
/// precision found: over longer steps, residuals of limited influence are not linear.
pub fn precise_fit(
    parameters: &mut [FitParameter],
    series: &[usize],
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Option<FitResult> {
    let mut found = None;
    for _ in 0..PASSES {
        let values = least_squares(parameters, residuals)?;
        let covariance = covariance(parameters, &values, series, residuals)?;
        for (index, parameter) in parameters.iter_mut().enumerate() {
            parameter.start = values[index];
            let sd = covariance[(index, index)].sqrt();
            if sd > 0.0 {
                parameter.step = parameter.step.min(STEP_SHARE * sd);
            }
        }
        found = Some(FitResult { values, covariance });
    }
    found
}

impl FitParameter {
    /// Initial value, limited to the bounds.
    fn inside(&self) -> f64 {
        let [low, high] = self.bounds;
        if self.is_fixed {
            return self.start;
        }
        self.start.clamp(low + self.step, high - self.step)
    }

    fn constraint(&self) -> MPPar {
        let [limit_low, limit_up] = self.bounds;
        MPPar {
            fixed: self.is_fixed,
            limited_low: true,
            limited_up: true,
            limit_low,
            limit_up,
            step: self.step,
            ..MPPar::new()
        }
    }
}

/// Covariance of a fit: the greater of the covariances for white and for correlated residuals (Newey and West, Econometrica 55
/// (1987) 703). The residuals consist of `series` of these lengths; neighbours in a series are neighbours in time.
fn covariance(
    parameters: &[FitParameter],
    values: &[f64],
    series: &[usize],
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Option<DMatrix<f64>> {
    let best = residuals(values);
    let free: Vec<usize> = (0..values.len()).filter(|k| !parameters[*k].is_fixed).collect();
    let mut jacobian = DMatrix::zeros(best.len(), free.len());
    for (column, index) in free.iter().copied().enumerate() {
        let parameter = &parameters[index];
        let moved = |by: f64| {
            let mut values = values.to_vec();
            values[index] += by;
            DVector::from_vec(residuals(&values))
        };
        // One-sided at a bound.
        let [low, high] = parameter.bounds;
        let above = parameter.step.min(high - values[index]);
        let below = parameter.step.min(values[index] - low);
        let slope = (moved(above) - moved(-below)) / (above + below);
        jacobian.set_column(column, &slope);
    }
    let mut information = jacobian.transpose() * &jacobian;
    for (column, index) in free.iter().copied().enumerate() {
        // A parameter without influence on the residuals is known only by its bounds.
        let [low, high] = parameters[index].bounds;
        information[(column, column)] += (high - low).powi(-2);
    }
    let white = information.try_inverse()?;
    let freedom = best.len().saturating_sub(free.len()).max(1) as f64;
    let square = best.iter().map(|residual| residual * residual).sum::<f64>() / freedom;
    let scores =
        DMatrix::from_fn(best.len(), free.len(), |row, column| jacobian[(row, column)] * best[row]);
    let meat = long_run(&scores, series);
    let correlated = &white * meat * &white;
    let white = white * square;
    // Scales the white covariance, so that the correlations of the parameters remain.
    let scale =
        DVector::from_fn(free.len(), |k, _| (correlated[(k, k)] / white[(k, k)]).max(1.0).sqrt());
    let mut whole = DMatrix::zeros(values.len(), values.len());
    for (i, j) in (0..free.len()).flat_map(|i| (0..free.len()).map(move |j| (i, j))) {
        whole[(free[i], free[j])] = white[(i, j)] * scale[i] * scale[j];
    }
    Some(whole)
}

/// Sum of the products of scores with those in the same and in neighbouring rows of a series.
fn long_run(scores: &DMatrix<f64>, series: &[usize]) -> DMatrix<f64> {
    let mut sum = scores.transpose() * scores;
    let mut begin = 0;
    for length in series.iter().copied() {
        // Twice the number of neighbours in the rule of Newey and West.
        let lags = (8.0 * (length as f64 / 100.0).powf(2.0 / 9.0)).ceil() as usize;
        for lag in 1..=lags.min(length.saturating_sub(1)) {
            let weight = 1.0 - lag as f64 / (lags + 1) as f64;
            let early = scores.rows(begin, length - lag);
            let late = scores.rows(begin + lag, length - lag);
            let product = early.transpose() * late;
            sum += (&product + product.transpose()) * weight;
        }
        begin += length;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two minima in `x`: a shallow one near -1, and a deep one near 1.
    fn residuals(values: &[f64]) -> Vec<f64> {
        let x = values[0];
        vec![x * x - 1.0, 0.3 * (x - 1.0), 0.1]
    }

    fn from(start: f64) -> Vec<FitParameter> {
        vec![FitParameter { start, bounds: [-5.0, 5.0], step: 1e-3, is_fixed: false }]
    }

    #[test]
    fn the_best_of_several_optima_is_taken_and_the_others_are_told() {
        let mut parameters = from(-2.0);
        let told = move_to_best(&mut parameters, &[vec![2.0], vec![-3.0]], &residuals).unwrap();
        assert!((parameters[0].start - 1.0).abs() < 1e-6, "{parameters:?}");
        let precise = |sd: f64| FitResult {
            values: vec![parameters[0].start],
            covariance: DMatrix::from_element(1, 1, sd * sd),
        };
        let (elsewhere, excess_ratio) = told.elsewhere(&precise(0.1), 1);
        assert_eq!((told.count, elsewhere), (3, 2));
        assert!(excess_ratio > 1.0, "{told:?}");
        assert_eq!(told.elsewhere(&precise(5.0), 1).0, 0, "both optima are in the interval");
        assert_eq!(told.elsewhere(&precise(0.1), 0).0, 0, "the parameter is not reported");
        let moved = FitResult { values: vec![7.0], ..precise(1.5) };
        assert_eq!(told.elsewhere(&moved, 1).0, 0, "the optima are compared under the same noise");
    }

    #[test]
    fn a_start_that_is_as_good_as_any_is_kept() {
        let mut parameters = from(2.0);
        let told = move_to_best(&mut parameters, &[vec![3.0]], &residuals).unwrap();
        assert_eq!((parameters[0].start, told.others.len()), (2.0, 0));
    }
}
