//! A scalar PID with a filtered derivative and a limited integral. Fig. 16 has six of them.
//!
//! The paper gives no gains, limits or filters for it; only the three terms are in the paper.

use serde::{Deserialize, Serialize};

use crate::options::{OptionError, Rule, check_options};

/// Gains of a PID, in output per unit of error, of its integral over time, and of its rate of change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PidGains {
    /// Proportional gain \[output / error\].
    pub kp: f64,
    /// Integral gain \[output / (error s)\].
    pub ki: f64,
    /// Derivative gain \[output s / error\].
    pub kd: f64,
}

impl PidGains {
    /// Checks every gain.
    ///
    /// # Errors
    /// The first gain outside 0 to 1000.
    pub fn check(&self) -> Result<(), OptionError> {
        let rule = Rule::Between(0.0, 1000.0);
        check_options([("kp", self.kp, rule), ("ki", self.ki, rule), ("kd", self.kd, rule)])
    }
}

/// Symmetric limits of a [`Pid`], in units of its output, not negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidLimits {
    /// Greatest magnitude of the integral term \[unit of the output\].
    pub integral: f64,
    /// Greatest magnitude of the output \[unit of the output\]; infinite if the caller limits it.
    pub output: f64,
}

/// A PID and its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid {
    gains: PidGains,
    limits: PidLimits,
    cutoff_hz: f64,
    frozen: bool,
    /// The integral term, `ki` included, so that the output does not jump when the gains change.
    integral: f64,
    derivative: f64,
    previous_error: Option<f64>,
    output: f64,
}

impl Pid {
    /// A PID at rest. The derivative of the error passes a first-order low-pass of `cutoff_hz` \[Hz\].
    pub fn new(gains: PidGains, limits: PidLimits, cutoff_hz: f64) -> Self {
        Self {
            gains,
            limits,
            cutoff_hz,
            frozen: false,
            integral: 0.0,
            derivative: 0.0,
            previous_error: None,
            output: 0.0,
        }
    }

    /// Replaces the gains; the integral term stays, so that the output does not jump.
    pub fn set_gains(&mut self, gains: PidGains) {
        self.gains = gains;
    }

    /// Takes over the state of `old`, within the limits of this PID: the integral term does not jump.
    pub fn adopt(&mut self, old: &Self) {
        let limit = self.limits.integral;
        let integral = old.integral.clamp(-limit, limit);
        let Self { frozen, derivative, previous_error, output, .. } = *old;
        *self = Self { frozen, integral, derivative, previous_error, output, ..*self };
    }

    /// The output for the present error, `dt_s` \[s\] after the error before it.
    ///
    /// If the result is not finite, or `dt_s` is not positive and finite, the state is unchanged and the last output
    /// is returned, at first 0.
    pub fn update(&mut self, error: f64, dt_s: f64) -> f64 {
        let slope = self.previous_error.map_or(0.0, |previous| (error - previous) / dt_s);
        let derivative =
            self.derivative + low_pass_weight(self.cutoff_hz, dt_s) * (slope - self.derivative);
        let demand = self.gains.kp * error + self.integral + self.gains.kd * derivative;
        if !(demand.is_finite() && dt_s.is_finite() && dt_s > 0.0) {
            return self.output;
        }
        self.previous_error = Some(error);
        self.derivative = derivative;
        self.output = demand.clamp(-self.limits.output, self.limits.output);
        // Anti-windup by conditional integration: the integral may change only away from the limit.
        let deeper_into_limit = demand != self.output && demand * error > 0.0;
        if !(self.frozen || deeper_into_limit) {
            let integral = self.integral + self.gains.ki * error * dt_s;
            self.integral = integral.clamp(-self.limits.integral, self.limits.integral);
        }
        self.output
    }

    /// Holds the integral (`true`) or lets it run (`false`, as at first). The other terms are not affected.
    pub fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Resets the state. Gains, limits and [`Pid::freeze`] are kept.
    pub fn reset(&mut self) {
        *self = Self { frozen: self.frozen, ..Self::new(self.gains, self.limits, self.cutoff_hz) };
    }
}

/// Weight of a new value in a first-order low-pass of `cutoff_hz` \[Hz\] after `dt_s` \[s\] \[-\]; exact for a
/// constant input.
pub(crate) fn low_pass_weight(cutoff_hz: f64, dt_s: f64) -> f64 {
    -(-std::f64::consts::TAU * cutoff_hz * dt_s).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DT_S: f64 = 1.0 / 60.0;

    fn pid(kp: f64, ki: f64, kd: f64) -> Pid {
        Pid::new(PidGains { kp, ki, kd }, PidLimits { integral: 2.0, output: 3.0 }, 6.0)
    }

    #[test]
    fn proportional_term_is_gain_times_error() {
        assert_eq!(pid(2.0, 0.0, 0.0).update(0.75, DT_S), 1.5);
    }

    #[test]
    fn integral_term_grows_at_ki_times_error() {
        let mut pid = pid(0.0, 0.5, 0.0);
        let last = (0..=120).map(|_| pid.update(0.4, DT_S)).last().unwrap();
        assert!((last - 0.5 * 0.4 * 2.0).abs() < 1e-12);
    }

    #[test]
    fn derivative_of_a_ramp_settles_at_its_slope() {
        let mut pid = pid(0.0, 0.0, 0.5);
        let last = (0..60).map(|k| pid.update(1.2 * f64::from(k) * DT_S, DT_S)).last().unwrap();
        assert!((last - 0.5 * 1.2).abs() < 1e-9);
    }

    #[test]
    fn derivative_starts_without_a_kick() {
        assert_eq!(pid(0.0, 0.0, 5.0).update(1.0, DT_S), 0.0);
    }

    #[test]
    fn output_leaves_the_limit_as_soon_as_the_error_turns() {
        let mut pid = pid(1.0, 1.0, 0.0);
        for _ in 0..6000 {
            assert_eq!(pid.update(10.0, DT_S), 3.0);
        }
        // Nothing was integrated while the output was at its limit.
        assert_eq!(pid.update(-0.5, DT_S), -0.5);
    }

    #[test]
    fn frozen_integral_holds_its_value() {
        let mut pid = pid(0.0, 1.0, 0.0);
        pid.update(1.0, 0.5);
        pid.freeze(true);
        assert_eq!(pid.update(7.0, 0.5), 0.5);
        assert_eq!(pid.update(7.0, 0.5), 0.5);
        pid.freeze(false);
        pid.update(1.0, 0.5);
        assert_eq!(pid.update(1.0, 0.5), 1.0);
    }

    #[test]
    fn a_reset_discards_the_past() {
        let mut used = pid(1.0, 1.0, 1.0);
        used.update(1.0, 0.5);
        used.update(2.0, 0.5);
        used.reset();
        assert_eq!(used, pid(1.0, 1.0, 1.0));
    }

    #[test]
    fn negative_and_non_finite_gains_fail_the_check() {
        let gains = PidGains { kp: 1.0, ki: 0.0, kd: 0.0 };
        assert_eq!(gains.check(), Ok(()));
        assert!(PidGains { kp: -1.0, ..gains }.check().is_err());
        assert!(PidGains { kd: f64::NAN, ..gains }.check().is_err());
    }

    proptest! {
        #[test]
        fn output_is_finite_and_within_its_limit_for_any_input(
            samples in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY), 1..40),
        ) {
            let mut pid = pid(1.0, 1.0, 0.1);
            for (error, dt_s) in samples {
                prop_assert!(pid.update(error, dt_s).abs() <= 3.0);
                prop_assert!(pid.integral.abs() <= 2.0);
            }
        }

        #[test]
        fn invalid_input_changes_nothing(
            errors in prop::collection::vec(-5.0..5.0, 1..20),
            bad in prop_oneof![
                Just((f64::NAN, DT_S)), Just((f64::INFINITY, DT_S)),
                Just((1.0, 0.0)), Just((1.0, -DT_S)), Just((1.0, f64::NAN)), Just((0.0, f64::INFINITY)),
            ],
        ) {
            let mut pid = pid(1.0, 1.0, 0.1);
            let last = errors.iter().map(|error| pid.update(*error, DT_S)).last().unwrap();
            let before = pid;
            prop_assert_eq!(pid.update(bad.0, bad.1), last);
            prop_assert_eq!(pid, before);
        }
    }
}
