//! Whiteness tests of residuals: white residuals contain nothing that a better model could predict.

use serde::Serialize;

/// Number of neighbours whose correlation is tested \[-\].
const NEIGHBOURS: usize = 20;
/// Critical value of the statistic at 1 %: chi-square with 20 degrees of freedom \[-\].
const CRITICAL: f64 = 37.57;
/// Size above which a residual counts as an outlier \[standard deviations\].
const OUTLIER: f64 = 4.0;

/// Test result for the residuals of one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResidualTest {
    /// Quantity and axis.
    pub name: String,
    /// Number of residuals \[-\].
    pub count: usize,
    /// Correlation of successive residuals \[-\].
    pub next_ratio: f64,
    /// Statistic of Ljung and Box (Biometrika 65 (1978) 297) over twenty neighbours \[-\].
    pub ljung_box_ratio: f64,
    /// Whether the statistic is below the 99 % quantile of white residuals.
    pub is_white: bool,
    /// Fraction of the residuals beyond four standard deviations \[-\].
    pub outliers_ratio: f64,
}

impl ResidualTest {
    /// Tests `residuals` \[standard deviations\].
    pub fn of(name: String, residuals: &[f64]) -> Self {
        let count = residuals.len();
        // A single outlier would hide every correlation.
        let limited: Vec<f64> = residuals.iter().map(|r| r.clamp(-OUTLIER, OUTLIER)).collect();
        let square = limited.iter().map(|r| r * r).sum::<f64>().max(f64::MIN_POSITIVE);
        let correlation = |lag: usize| {
            let pairs = limited.iter().zip(limited.iter().skip(lag));
            pairs.map(|(a, b)| a * b).sum::<f64>() / square
        };
        let n = count as f64;
        let terms = (1..=NEIGHBOURS.min(count.saturating_sub(1)))
            .map(|lag| correlation(lag).powi(2) / (n - lag as f64));
        let ljung_box_ratio = n * (n + 2.0) * terms.sum::<f64>();
        let outliers = residuals.iter().filter(|r| r.abs() > OUTLIER).count() as f64;
        Self {
            name,
            count,
            next_ratio: correlation(1),
            ljung_box_ratio,
            is_white: ljung_box_ratio <= CRITICAL,
            outliers_ratio: outliers / n.max(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    #[test]
    fn a_moving_average_is_not_white_and_random_numbers_are() {
        let mut random = SplitMix64::new(1);
        let white: Vec<f64> = (0..2000).map(|_| random.between(-1.5, 1.5)).collect();
        let smooth: Vec<f64> = white.windows(2).map(|pair| pair[0] + 0.3 * pair[1]).collect();
        assert!(ResidualTest::of("white".into(), &white).is_white);
        assert!(!ResidualTest::of("smooth".into(), &smooth).is_white);
    }
}
