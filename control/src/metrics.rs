//! Figures of merit of a flight: the metrics of Table II, and running statistics.
//!
//! Table II defines quaternion error, position error and effort as integrals of norms, but its cost function, and
//! Eq. (60), have squares. The printed results agree with norms (Table III: fitness = q times its quaternion error plus
//! r times its effort), so both forms are kept (erratum E-60).
//!
//! A number that is not finite makes every figure that contains it not finite, so that a failed flight never has good figures.

use nalgebra::Vector3;

/// Input of the metrics at one time of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MetricSample {
    /// Reference minus position \[m, world\].
    pub position_error: Vector3<f64>,
    /// Vector part of the quaternion error `q_e = q_d^-1 (x) q`, shorter way round \[-\].
    pub quaternion_error: Vector3<f64>,
    /// Command of the attitude law: torque \[N m, body axes\], or sticks \[-1..1, body axes\] in rate-input form.
    pub input: Vector3<f64>,
}

/// Weights of the cost function, Table II and Eq. (60).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostWeights {
    /// Weight of the quaternion error \[-\].
    pub q: f64,
    /// Weight of the effort \[1/U, with squares 1/U^2\].
    pub r: f64,
}

/// The metrics of Table II over a flight. `U` stands for the unit of [`MetricSample::input`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TableTwo {
    /// Integral of the norm of the position error \[m s\].
    pub position_error: f64,
    /// Integral of the norm of the quaternion error \[s\].
    pub quaternion_error: f64,
    /// Integral of the squared norm of the quaternion error \[s\].
    pub quaternion_error_squared: f64,
    /// Integral of the norm of the input \[U s\].
    pub effort: f64,
    /// Integral of the squared norm of the input \[U^2 s\].
    pub effort_squared: f64,
    /// Number of Riccati equations solved, the first one included; counted by the controller \[-\].
    pub riccati_solves: u64,
}

impl TableTwo {
    /// Adds a sample that holds for `dt_s` \[s\].
    pub fn add(&mut self, sample: &MetricSample, dt_s: f64) {
        // Table II, erratum E-60: the quaternion error is that of epsilon; the norm of `Q_d q` is always one.
        self.position_error += sample.position_error.norm() * dt_s;
        self.quaternion_error += sample.quaternion_error.norm() * dt_s;
        self.quaternion_error_squared += sample.quaternion_error.norm_squared() * dt_s;
        self.effort += sample.input.norm() * dt_s;
        self.effort_squared += sample.input.norm_squared() * dt_s;
    }

    /// The cost as printed: the integral of `q eps'eps + r tau'tau` \[s\].
    pub fn cost(&self, weights: CostWeights) -> f64 {
        // Eq. (60)
        weights.q * self.quaternion_error_squared + weights.r * self.effort_squared
    }

    /// The cost that the printed tables follow: the integral of `q |eps| + r |tau|` \[s\].
    pub fn cost_of_norms(&self, weights: CostWeights) -> f64 {
        // Eq. (60), erratum E-60
        weights.q * self.quaternion_error + weights.r * self.effort
    }
}

/// Running mean, root mean square and maximum of magnitudes, in constant memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    count: u64,
    mean: f64,
    mean_square: f64,
    max: f64,
}

impl Statistics {
    /// Adds a magnitude, `value >= 0`.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let weight = 1.0 / self.count as f64;
        self.mean += weight * (value - self.mean);
        self.mean_square += weight * (value * value - self.mean_square);
        // Unlike `f64::max`, this keeps a NaN.
        if value > self.max || value.is_nan() {
            self.max = value;
        }
    }

    /// Number of values added \[-\].
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Arithmetic mean \[unit of the values\]; 0 before the first value.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Root of the mean square \[unit of the values\]; 0 before the first value.
    pub fn rms(&self) -> f64 {
        self.mean_square.sqrt()
    }

    /// Greatest value \[unit of the values\]; 0 before the first.
    pub fn max(&self) -> f64 {
        self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Values of a metric for weights [q, r]: the printed columns of Table III.
    const TABLE_3: [([f64; 2], f64, f64, f64); 3] = [
        ([1.0, 1.0], 0.1280, 0.2609, 0.3889),
        ([10.0, 1.0], 0.0349, 0.8252, 1.1744),
        ([100.0, 1.0], 0.0328, 0.9476, 4.2286),
    ];

    #[test]
    fn integrals_of_a_constant_sample_are_value_times_time() {
        let sample = MetricSample {
            position_error: Vector3::new(3.0, 0.0, 4.0),
            quaternion_error: Vector3::new(0.0, 0.1, 0.0),
            input: Vector3::new(0.0, 0.0, -0.2),
        };
        let mut metrics = TableTwo::default();
        for _ in 0..100 {
            metrics.add(&sample, 0.02);
        }
        let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-12);
        near(metrics.position_error, 10.0);
        near(metrics.quaternion_error, 0.2);
        near(metrics.quaternion_error_squared, 0.02);
        near(metrics.effort, 0.4);
        near(metrics.effort_squared, 0.08);
        let weights = CostWeights { q: 10.0, r: 0.5 };
        near(metrics.cost(weights), 0.24);
        near(metrics.cost_of_norms(weights), 2.2);
    }

    #[test]
    fn printed_fitness_is_the_cost_of_norms() {
        for ([q, r], quaternion_error, effort, fitness) in TABLE_3 {
            let printed = TableTwo { quaternion_error, effort, ..TableTwo::default() };
            // The columns are printed with four decimals; q scales their rounding.
            assert!(
                (printed.cost_of_norms(CostWeights { q, r }) - fitness).abs() <= 5e-5 * (q + 2.0)
            );
        }
    }

    #[test]
    fn a_nan_is_not_hidden() {
        let mut statistics = Statistics::default();
        for value in [1.0, f64::NAN, 0.5] {
            statistics.add(value);
        }
        assert!(
            statistics.mean().is_nan() && statistics.rms().is_nan() && statistics.max().is_nan()
        );
    }

    proptest! {
        #[test]
        fn statistics_agree_with_their_definitions(values in prop::collection::vec(0.0..100.0, 1..200)) {
            let mut statistics = Statistics::default();
            values.iter().for_each(|value| statistics.add(*value));
            let n = values.len() as f64;
            let rms = (values.iter().map(|value| value * value).sum::<f64>() / n).sqrt();
            prop_assert!((statistics.mean() - values.iter().sum::<f64>() / n).abs() < 1e-9);
            prop_assert!((statistics.rms() - rms).abs() < 1e-9);
            prop_assert_eq!(statistics.max(), values.iter().copied().fold(0.0, f64::max));
            prop_assert_eq!(statistics.count(), values.len() as u64);
        }
    }
}
