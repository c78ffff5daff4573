//! Statistics of a finished sample: mean, standard deviation, quantiles, correlation, confidence interval of the mean.
//!
//! Running statistics, in constant memory, are [`crate::metrics::Statistics`].

/// Arithmetic mean \[unit of the values\]; NaN without values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Standard deviation of the sample, with `n - 1` in the denominator \[unit of the values\]; 0 for a single value.
pub fn standard_deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (values.len() as f64 - 1.0).max(1.0)).sqrt()
}

/// Standard deviation of a whole population, with `n` in the denominator \[unit of the values\]; NaN without values.
pub fn population_deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / values.len() as f64).sqrt()
}

/// Middle value, of an even number of values the mean of the two in the middle; NaN values are left out. `None` without values
/// \[unit of the values\].
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let sorted = sorted(values);
    let (lower, upper) = (sorted.len().saturating_sub(1) / 2, sorted.len() / 2);
    match lower == upper {
        true => sorted.get(upper).copied(),
        false => Some(0.5 * (sorted[lower] + sorted[upper])),
    }
}

/// Least value that a share \[0..1\] of the values does not exceed, by nearest rank; NaN values are left out. `None` without values
/// \[unit of the values\].
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> Option<f64> {
    let sorted = sorted(values);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied()
}

fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Pearson's correlation of two series of equal length \[-1..1\]; NaN if one of them is constant.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sum = |product: fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| product(x - mean_a, y - mean_b)).sum()
    };
    sum(|x, y| x * y) / (sum(|x, _| x * x) * sum(|_, y| y * y)).sqrt()
}

/// Spearman's rank correlation of two series of equal length \[-1..1\]; NaN if one of them is constant.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    correlation(&ranks(a), &ranks(b))
}

/// Ranks of the values; equal values share the mean of their ranks.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for equal in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let rank = first as f64 + 0.5 * (equal.len() - 1) as f64;
        equal.iter().for_each(|index| ranks[*index] = rank);
        first += equal.len();
    }
    ranks
}

/// A mean with its 95 % confidence interval, by Student's t over independent values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Mean \[unit of the values\].
    pub mean: f64,
    /// Half the width of the interval \[unit of the values\]; infinite for a single value.
    pub half: f64,
}

impl Interval {
    /// Interval of the mean of independent values.
    pub fn of(values: &[f64]) -> Self {
        let half = match values.len() {
            0 | 1 => f64::INFINITY,
            count => student(count - 1) * standard_deviation(values) / (count as f64).sqrt(),
        };
        Self { mean: mean(values), half }
    }

    /// Upper end \[unit of the values\].
    pub fn high(&self) -> f64 {
        self.mean + self.half
    }

    /// Lower end \[unit of the values\].
    pub fn low(&self) -> f64 {
        self.mean - self.half
    }

    /// Whether the two intervals are disjoint. Means with overlapping intervals may still differ: the test is conservative.
    pub fn is_apart_from(&self, other: &Self) -> bool {
        self.high() < other.low() || other.high() < self.low()
    }
}

/// The 97.5 % quantile of Student's distribution with `degrees` of freedom, at least 1.
fn student(freedom: usize) -> f64 {
    /// Quantiles of tables, for 1 to 10 degrees.
    const FIRST: [f64; 10] =
        [12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281];
    /// The same quantile of the normal distribution.
    const Z: f64 = 1.959_964;
    if let Some(quantile) = FIRST.get(freedom - 1) {
        return *quantile;
    }
    // Cornish and Fisher's expansion, Abramowitz and Stegun 26.7.5
    let v = freedom as f64;
    let terms = [
        (Z.powi(3) + Z) / 4.0,
        (5.0 * Z.powi(5) + 16.0 * Z.powi(3) + 3.0 * Z) / 96.0,
        (3.0 * Z.powi(7) + 19.0 * Z.powi(5) + 17.0 * Z.powi(3) - 15.0 * Z) / 384.0,
    ];
    Z + terms[0] / v + terms[1] / v.powi(2) + terms[2] / v.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_deviation_is_that_of_a_sample() {
        assert_eq!((mean(&[1.0, 2.0, 6.0]), standard_deviation(&[1.0, 3.0])), (3.0, 2_f64.sqrt()));
        assert_eq!(standard_deviation(&[5.0]), 0.0);
        assert_eq!(population_deviation(&[1.0, 3.0]), 1.0);
        assert!(mean(&[]).is_nan());
    }

    #[test]
    fn the_median_lies_in_the_middle() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, f64::NAN, 1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!(median([1.0, f64::INFINITY]), Some(f64::INFINITY));
        assert_eq!(median([7.0]), Some(7.0));
        assert_eq!(median([]), None);
    }

    #[test]
    fn quantiles_are_values_of_the_sample() {
        let values = [4.0, 1.0, f64::INFINITY, 3.0, f64::NAN];
        assert_eq!(quantile(values, 0.5), Some(3.0));
        assert_eq!(
            (quantile(values, 0.0), quantile(values, 1.0)),
            (Some(1.0), Some(f64::INFINITY))
        );
        let hundred = || (1..=100).rev().map(f64::from);
        assert_eq!((quantile(hundred(), 0.5), quantile(hundred(), 0.99)), (Some(50.0), Some(99.0)));
        assert_eq!(quantile([], 0.5), None);
    }

    #[test]
    fn a_monotonic_dependence_has_a_rank_correlation_of_one() {
        let [x, y]: [Vec<f64>; 2] = [f64::from, |k: i32| f64::from(k).exp()]
            .map(|f: fn(i32) -> f64| (0..9).map(f).collect());
        assert!(correlation(&x, &y) < 0.9);
        assert!((rank_correlation(&x, &y) - 1.0).abs() < 1e-12);
        assert!(correlation(&x, &[1.0; 9]).is_nan());
        assert_eq!(ranks(&[2.0, 1.0, 2.0]), [1.5, 0.0, 1.5]);
    }

    #[test]
    fn the_quantiles_of_student_are_those_of_the_tables() {
        for (freedom, quantile) in [(1, 12.706), (4, 2.776), (11, 2.201), (24, 2.064), (120, 1.980)]
        {
            assert!((student(freedom) - quantile).abs() < 6e-4, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn disjoint_intervals_are_apart() {
        let [a, b, c] =
            [[1.0, 1.1, 0.9], [2.0, 2.1, 1.9], [1.0, 3.0, 2.0]].map(|v| Interval::of(&v));
        assert!((a.half - 4.3027 * 0.1 / 3.0_f64.sqrt()).abs() < 1e-9);
        assert!(a.is_apart_from(&b) && b.is_apart_from(&a) && !a.is_apart_from(&c));
    }

    #[test]
    fn an_infinite_or_single_value_is_apart_from_nothing() {
        let finite = Interval::of(&[1.0, 1.1]);
        for other in [Interval::of(&[f64::INFINITY, 1.0]), Interval::of(&[5.0])] {
            assert!(!finite.is_apart_from(&other) && !other.is_apart_from(&finite));
        }
    }
}
