//! Thrust of a Crazyflie over the counts that command it.

use super::setpoint::MAX_CRTP_THRUST;

/// Counts of a duty cycle of one.
const FULL_DUTY: f64 = 65_535.0;

/// Collective thrust `linear u + quadratic u^2` over the commanded duty cycle `u` of all motors, counts / 65535.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrtpThrustCurve {
    linear: f64,
    quadratic: f64,
}

impl CrtpThrustCurve {
    /// Curve of these coefficients \[N\]; `None` unless it rises from zero to full duty.
    pub fn new([linear, quadratic]: [f64; 2]) -> Option<Self> {
        let rises = linear >= 0.0 && linear + 2.0 * quadratic >= 0.0 && linear + quadratic > 0.0;
        (rises && linear.is_finite() && quadratic.is_finite()).then_some(Self { linear, quadratic })
    }

    /// Collective thrust of `counts` \[N\].
    pub fn force(&self, counts: u16) -> f64 {
        let duty = f64::from(counts.min(MAX_CRTP_THRUST)) / FULL_DUTY;
        duty * (self.linear + self.quadratic * duty)
    }

    /// Counts of a collective thrust `force` \[N\], within 0..60000; 0 for NaN.
    pub fn counts(&self, force: f64) -> u16 {
        if force.is_nan() || force <= 0.0 {
            return 0;
        }
        let Self { linear, quadratic } = *self;
        let root = (linear * linear + 4.0 * quadratic * force).max(0.0).sqrt();
        // The root that is also right without a quadratic part; beyond a falling branch the thrust is the greatest.
        let duty = 2.0 * force / (linear + root).max(f64::MIN_POSITIVE);
        (duty * FULL_DUTY).round().min(f64::from(MAX_CRTP_THRUST)) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_give_the_thrust_that_they_were_made_of() {
        for curve in [[0.5886, 0.0], [0.2707, 0.366], [0.0, 0.6], [0.8, -0.2]] {
            let curve = CrtpThrustCurve::new(curve).unwrap();
            for counts in (0..=60_000).step_by(500) {
                assert_eq!(curve.counts(curve.force(counts)), counts, "{curve:?}");
            }
            assert_eq!(curve.counts(1e9), MAX_CRTP_THRUST);
            assert_eq!([curve.counts(f64::NAN), curve.counts(-1.0)], [0, 0]);
        }
    }

    #[test]
    fn a_curve_must_rise() {
        for wrong in [[0.0, 0.0], [-0.1, 1.0], [1.0, -0.6], [f64::NAN, 1.0]] {
            assert_eq!(CrtpThrustCurve::new(wrong), None);
        }
    }
}
