//! Confidence intervals by resampling, for figures without a formula: quantiles, medians of ratios, shares.

use oqtal_control::statistics::quantile;

use crate::random::SplitMix64;

/// Number of samples drawn \[-\].
const RESAMPLES: usize = 1000;

/// Seed of the samples.
const SEED: u64 = 1979;

/// A figure with its 95 % confidence interval: the percentile bootstrap (Efron, Ann. Stat. 7 (1979) 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BootstrapInterval {
    /// The figure of all items \[unit of the figure\].
    pub value: f64,
    /// Lower end \[unit of the figure\].
    pub low: f64,
    /// Upper end \[unit of the figure\].
    pub high: f64,
}

impl BootstrapInterval {
    /// Interval of `figure` over `items`, which are independent of each other; NaN without items.
    pub fn of<T: Clone>(items: &[T], figure: impl Fn(&[T]) -> f64) -> Self {
        let value = figure(items);
        let mut random = SplitMix64::new(SEED);
        let mut sample = items.to_vec();
        let figures: Vec<f64> = (0..if items.is_empty() { 0 } else { RESAMPLES })
            .map(|_| {
                sample.fill_with(|| items[random.below(items.len())].clone());
                figure(&sample)
            })
            .collect();
        let end = |share| quantile(figures.iter().copied(), share).unwrap_or(f64::NAN);
        Self { value, low: end(0.025), high: end(0.975) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_control::statistics::{Interval, mean, median};

    #[test]
    fn the_interval_of_a_mean_is_that_of_student() {
        let mut random = SplitMix64::new(3);
        let values: Vec<f64> = (0..400).map(|_| random.normal()).collect();
        let (ours, student) = (BootstrapInterval::of(&values, mean), Interval::of(&values));
        assert_eq!(ours.value, student.mean);
        for (end, expected) in [(ours.low, student.low()), (ours.high, student.high())] {
            assert!((end - expected).abs() < 0.15 * student.half, "{ours:?}, {student:?}");
        }
    }

    #[test]
    fn the_interval_contains_the_true_quantile_in_most_samples() {
        let mut random = SplitMix64::new(5);
        let middle = |values: &[f64]| median(values.iter().copied()).unwrap();
        let contains = |_: &u32| {
            let values: Vec<f64> = (0..100).map(|_| random.between(-1.0, 1.0)).collect();
            let interval = BootstrapInterval::of(&values, middle);
            interval.low <= 0.0 && interval.high >= 0.0
        };
        let count = (0..200).filter(contains).count();
        assert!((180..=199).contains(&count), "{count} of 200, 190 expected");
    }

    #[test]
    fn no_items_have_no_interval() {
        let none = BootstrapInterval::of(&[0.0; 0], mean);
        assert!(none.value.is_nan() && none.low.is_nan() && none.high.is_nan());
    }
}
