//! Maximum-likelihood estimate of the noise, from the innovations of a flight.

use nalgebra::Vector3;

use super::robust::{deviation, huber};

/// Innovations of a predictor at every pose except the first, with their expected variances.
#[derive(Clone, Debug, Default)]
pub struct Innovations {
    /// Measured minus predicted: attitude \[rad, body\] or position \[m, world\].
    pub values: Vec<Vector3<f64>>,
    /// Expected variance of each component over the measurement variance \[-\].
    pub variances: Vec<f64>,
}

impl Innovations {
    /// Adds an innovation and its expected variance over the measurement variance \[-\].
    pub fn push(&mut self, (value, variance): (Vector3<f64>, f64)) {
        self.values.push(value);
        self.variances.push(variance);
    }

    /// Innovations of an axis in expected standard deviations, for the measurement deviation `measured` \[unit of the
    /// innovations\].
    pub fn normalised(&self, measured: f64, axis: usize) -> Vec<f64> {
        let pairs = self.values.iter().zip(&self.variances);
        pairs.map(|(value, variance)| value[axis] / (measured * variance.sqrt())).collect()
    }
}

/// Residuals of a fit: innovations of every flight, axis by axis, with limited influence \[expected standard deviations\], times the
/// geometric mean of the expected deviations over the measurement deviation. Least squares of this product maximise the likelihood; without
/// the factor, parameters for which the filter expects greater innovations would appear better than they are.
pub fn residuals<'a>(
    flights: impl Iterator<Item = &'a Innovations> + Clone,
    measured: f64,
) -> Vec<f64> {
    let variances = flights.clone().flat_map(|flight| &flight.variances);
    let (sum, count) =
        variances.fold((0.0, 0.0), |(sum, n), variance| (sum + variance.ln(), n + 1.0));
    let scale = (0.5 * sum / f64::max(count, 1.0)).exp();
    let axes = flights.flat_map(|flight| (0..3).map(move |axis| (flight, axis)));
    let normalised = axes.flat_map(|(flight, axis)| flight.normalised(measured, axis));
    normalised.map(|residual| scale * huber(residual)).collect()
}

/// Smallest deviation of a measurement \[rad or m\]; for cameras without noise, the residuals are rounding errors of the
/// predictor.
const SMALLEST: f64 = 1e-6;

/// Maximum likelihood of innovations, and the measurement deviation at the maximum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likelihood {
    /// Logarithm of the likelihood, up to a constant \[-\].
    pub log: f64,
    /// Standard deviation of a measurement \[unit of the innovations\].
    pub measured: f64,
}

impl Likelihood {
    /// Likelihood of the innovations of all flights.
    pub fn of<'a>(flights: impl Iterator<Item = &'a Innovations>) -> Self {
        let (mut normalised, mut half_logs) = (Vec::new(), 0.0);
        for flight in flights {
            (0..3).for_each(|axis| normalised.extend(flight.normalised(1.0, axis)));
            half_logs += flight.variances.iter().map(|variance| 1.5 * variance.ln()).sum::<f64>();
        }
        let measured = deviation(&normalised).max(SMALLEST);
        Self { log: -(normalised.len() as f64) * measured.ln() - half_logs, measured }
    }
}

/// Number of refinement steps after the division of the range: precision of a percent.
const NARROWINGS: usize = 9;

/// Value between `low` and `high` \[any unit\] that maximises `of`: the best of `count` values in geometric progression, refined
/// by golden-section search in the logarithm.
pub fn best_in_proportion(
    [low, high]: [f64; 2],
    count: u32,
    mut of: impl FnMut(f64) -> f64,
) -> f64 {
    let ratio = (high / low).powf(1.0 / f64::from(count.max(2) - 1));
    let values = (0..count).map(|k| low * ratio.powf(f64::from(k)));
    let scored: Vec<(f64, f64)> = values.map(|value| (of(value), value)).collect();
    let best = scored.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(low, |(_, value)| *value);
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let (mut from, mut to) = ((best / ratio).max(low).ln(), (best * ratio).min(high).ln());
    let inner = |from: f64, to: f64| [to - golden * (to - from), from + golden * (to - from)];
    let mut points = inner(from, to);
    let mut scores = points.map(|log| of(log.exp()));
    for _ in 0..NARROWINGS {
        if scores[0] >= scores[1] {
            to = points[1];
            points = [inner(from, to)[0], points[0]];
            scores = [of(points[0].exp()), scores[0]];
        } else {
            from = points[0];
            points = [points[1], inner(from, to)[1]];
            scores = [scores[1], of(points[1].exp())];
        }
    }
    (0.5 * (from + to)).exp()
}

#[cfg(test)]
mod tests {
    use oqtal_runtime::random::{RandomSource, normal3, stream};

    use super::*;

    /// A fit must not prefer parameters for which a filter expects greater innovations than there are, or smaller ones.
    #[test]
    fn the_squares_of_residuals_are_least_for_the_true_variances() {
        let mut random = stream(7, RandomSource::Cameras);
        // Every other one has the other value.
        let alternate = |k: usize, other: f64| if k.is_multiple_of(2) { 1.0 } else { other };
        let values: Vec<Vector3<f64>> =
            (0..4000).map(|k| normal3(&mut random) * alternate(k, 1.5)).collect();
        let sum = |variance: f64| {
            let variances = (0..values.len()).map(|k| alternate(k, variance)).collect();
            let innovations = Innovations { values: values.clone(), variances };
            residuals(std::iter::once(&innovations), 1.0).iter().map(|r| r * r).sum::<f64>()
        };
        let [less, same, more] = [0.8, 1.0, 1.25].map(|factor| sum(factor * 2.25));
        assert!(same < less && same < more, "{less}, {same}, {more}");
    }
}
