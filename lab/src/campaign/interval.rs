//! Confidence intervals of means: whether two laws differ by more than the chance of their seeds.

/// A mean with its 95 % confidence interval, by Student's t over the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The mean \[unit of the values\].
    pub mean: f64,
    /// Half the width of the interval \[unit of the values\]; infinite for a single run.
    pub half: f64,
}

impl Interval {
    /// The interval of the mean of independent values.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        let (mean, sd) = super::statistics::mean_and_sd(values);
        let half = match values.len() {
            0 | 1 => f64::INFINITY,
            count => student(count - 1) * sd / (count as f64).sqrt(),
        };
        Self { mean, half }
    }

    /// The upper end.
    #[must_use]
    pub fn high(&self) -> f64 {
        self.mean + self.half
    }

    /// The lower end.
    #[must_use]
    pub fn low(&self) -> f64 {
        self.mean - self.half
    }

    /// Whether the two intervals are disjoint. Means with overlapping intervals may still differ: the test is conservative.
    #[must_use]
    pub fn is_apart_from(&self, other: &Self) -> bool {
        self.high() < other.low() || other.high() < self.low()
    }
}

/// The 97.5 % quantile of Student's distribution with `degrees` of freedom, at least 1.
fn student(freedom: usize) -> f64 {
    /// Printed in every table.
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
    fn the_quantiles_are_those_of_the_tables() {
        for (freedom, quantile) in [(1, 12.706), (4, 2.776), (11, 2.201), (24, 2.064), (120, 1.980)]
        {
            assert!((student(freedom) - quantile).abs() < 6e-4, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn intervals_are_apart_when_nothing_lies_in_both() {
        let [a, b, c] =
            [[1.0, 1.1, 0.9], [2.0, 2.1, 1.9], [1.0, 3.0, 2.0]].map(|v| Interval::of(&v));
        assert!((a.half - 4.3027 * 0.1 / 3.0_f64.sqrt()).abs() < 1e-9);
        assert!(a.is_apart_from(&b) && b.is_apart_from(&a) && !a.is_apart_from(&c));
    }

    #[test]
    fn what_is_not_finite_or_alone_is_apart_from_nothing() {
        let finite = Interval::of(&[1.0, 1.1]);
        for other in [Interval::of(&[f64::INFINITY, 1.0]), Interval::of(&[5.0])] {
            assert!(!finite.is_apart_from(&other) && !other.is_apart_from(&finite));
        }
    }
}
