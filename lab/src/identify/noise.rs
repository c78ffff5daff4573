//! The noise under which the innovations of a flight are most likely.

use nalgebra::Vector3;

use super::robust::deviation;

/// The likelihood of innovations, and the deviation of the measurements at which it is greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likelihood {
    /// Logarithm, up to a constant \[-\].
    pub log: f64,
    /// Standard deviation of a measurement \[unit of the innovations\].
    pub measured: f64,
}

impl Likelihood {
    /// Of `innovations` with these expected variances, each over that of a measurement.
    #[must_use]
    pub fn of<'a>(passes: impl Iterator<Item = (&'a [Vector3<f64>], &'a [f64])>) -> Self {
        let (mut normalised, mut half_logs) = (Vec::new(), 0.0);
        for (innovations, variances) in passes {
            for (innovation, variance) in innovations.iter().zip(variances) {
                normalised.extend(innovation.iter().map(|e| e / variance.sqrt()));
                half_logs += 1.5 * variance.ln();
            }
        }
        let measured = deviation(&normalised).max(f64::MIN_POSITIVE);
        Self { log: -(normalised.len() as f64) * measured.ln() - half_logs, measured }
    }
}

/// The value between `low` and `high` \[any unit\] at which `of` is greatest: the best of `count` values that divide the range evenly in
/// proportion.
pub fn best_in_proportion(
    [low, high]: [f64; 2],
    count: u32,
    mut of: impl FnMut(f64) -> f64,
) -> f64 {
    let ratio = (high / low).powf(1.0 / f64::from(count.max(2) - 1));
    let values = (0..count).map(|k| low * ratio.powf(f64::from(k)));
    let scored: Vec<(f64, f64)> = values.map(|value| (of(value), value)).collect();
    let best = scored.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(low, |(_, value)| *value)
}
