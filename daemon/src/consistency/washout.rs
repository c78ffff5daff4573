//! Wash-out of a rotation: the part of it that is faster than a second.

use nalgebra::Vector3;

/// Corner of the filter \[rad/s\]. Lower corners show slower rotations, and need a longer memory.
const CORNER_RAD_S: f64 = 1.5;
/// Damping of the filter \[-\].
const DAMPING: f64 = 0.7;

/// High-pass filter of second order, `s^2 / (s^2 + 2 z w s + w^2)`, about each axis: the response to an offset and to a constant rate
/// decays to zero.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WashOut {
    angle: Vector3<f64>,
    rate: Vector3<f64>,
}

impl WashOut {
    /// Takes the rotation of an interval of `dt_s` \[s\] \[rad, body axes\]; returns the filtered angle \[rad, body axes\].
    pub(super) fn take(&mut self, turn: &Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let passed = self.angle + turn - self.rate * dt_s;
        self.angle = passed * (1.0 - (2.0 * DAMPING * CORNER_RAD_S * dt_s).min(1.0));
        self.rate += passed * (CORNER_RAD_S * CORNER_RAD_S * dt_s);
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest angle after `after_s` \[s\] of the filter's answer to a rotation of `angle(t)` \[rad\].
    fn largest(angle: impl Fn(f64) -> f64, after_s: f64) -> f64 {
        let (mut filter, dt_s) = (WashOut::default(), 1.0 / 60.0);
        let mut largest = 0.0_f64;
        for step in 0..1200 {
            let t_s = f64::from(step) * dt_s;
            let turn = Vector3::repeat(angle(t_s + dt_s) - angle(t_s));
            let passed = filter.take(&turn, dt_s);
            if t_s > after_s {
                largest = largest.max(passed.amax());
            }
        }
        largest
    }

    #[test]
    fn a_constant_rate_is_washed_out_and_an_oscillation_passes() {
        assert!(largest(|t_s| 0.3 + 0.2 * t_s, 8.0) < 1e-4);
        let passed = largest(|t_s| 0.1 * (10.0 * t_s).sin(), 8.0);
        assert!((0.09..0.11).contains(&passed), "{passed}");
    }
}
