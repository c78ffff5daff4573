//! Velocity and body rate from measured poses.
//!
//! Motion capture gives position and attitude only; the loops also need their rates. [`Estimator`] differentiates the
//! poses over the true time between them and filters the result. Not in the paper, which names noise treatment as an
//! option only (section VII.C).

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::options::{OptionError, Rule, check_options};
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;
use crate::scalar_pid::low_pass_weight;

/// Options of the [`Estimator`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct EstimatorOptions {
    /// Cut-off of the first-order low-pass on the velocity \[Hz\].
    pub velocity_cutoff_hz: f64,
    /// Cut-off of the first-order low-pass on the body rate \[Hz\].
    pub rate_cutoff_hz: f64,
    /// Longest time between two poses that are differentiated \[ms\].
    pub gap_ms: f64,
}

impl Default for EstimatorOptions {
    fn default() -> Self {
        // At 60 Hz the gap covers two consecutive lost frames.
        Self { velocity_cutoff_hz: 6.0, rate_cutoff_hz: 6.0, gap_ms: 60.0 }
    }
}

impl EstimatorOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("velocity-cutoff-hz", self.velocity_cutoff_hz, Rule::Between(0.1, 1000.0)),
            ("rate-cutoff-hz", self.rate_cutoff_hz, Rule::Between(0.1, 1000.0)),
            ("gap-ms", self.gap_ms, Rule::Between(1.0, 1000.0)),
        ])
    }
}

/// Estimated motion of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Position of the body \[m, world\].
    pub position: Vector3<f64>,
    /// Velocity of the body \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// Attitude, body to world.
    pub attitude: Attitude,
    /// Angular velocity of the body \[rad/s, body axes\].
    pub rate: BodyRate,
}

/// Estimates the motion from poses by first-order filtered differences.
#[derive(Clone, Copy, Debug)]
pub struct Estimator {
    options: EstimatorOptions,
    /// Stamp of the last pose taken \[s\].
    last_t_s: Option<f64>,
    estimate: Estimate,
}

impl Estimator {
    /// An estimator without a pose yet.
    pub fn new(options: EstimatorOptions) -> Self {
        Self { options, last_t_s: None, estimate: Estimate::default() }
    }

    /// Takes the pose captured at `t_s` \[s, any origin\]: `position` \[m, world\] and `attitude`, and returns the motion
    /// at that time.
    ///
    /// A pose that is not later than the last one, or does not give a finite estimate, is ignored. After a gap the pose is taken
    /// and the rates are held until the next one, because an average over the gap would be out of date and zero would be a jump.
    pub fn update(&mut self, t_s: f64, position: Vector3<f64>, attitude: Attitude) -> Estimate {
        let dt_s = self.last_t_s.map(|last| t_s - last);
        let (velocity, rate) = match dt_s {
            Some(dt_s) if dt_s <= self.options.gap_ms * 1e-3 => {
                self.rates(dt_s, &position, &attitude)
            }
            _ => (self.estimate.velocity, self.estimate.rate.0),
        };
        let vectors = [position, velocity, rate];
        let mut numbers = vectors.iter().flatten().copied().chain(attitude.xyzw()).chain([t_s]);
        if numbers.all(f64::is_finite) && dt_s.is_none_or(|dt_s| dt_s > 0.0) {
            self.last_t_s = Some(t_s);
            self.estimate = Estimate { position, velocity, attitude, rate: BodyRate(rate) };
        }
        self.estimate
    }

    /// The motion at the last pose, for a tick without a new pose; all zero and level before the first pose.
    pub fn latest(&self) -> Estimate {
        self.estimate
    }

    /// Velocity and body rate after a pose that follows the last one by `dt_s` \[s\].
    ///
    /// The weight of the low-pass falls with `dt_s` as fast as the noise of the difference quotient grows, so poses
    /// close together need no special treatment.
    fn rates(
        &self,
        dt_s: f64,
        position: &Vector3<f64>,
        attitude: &Attitude,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let Estimate { velocity, rate: BodyRate(rate), .. } = self.estimate;
        let raw_velocity = (position - self.estimate.position) / dt_s;
        let raw_rate = self.estimate.attitude.rotation_to(attitude) / dt_s;
        (
            velocity
                + (raw_velocity - velocity)
                    * low_pass_weight(self.options.velocity_cutoff_hz, dt_s),
            rate + (raw_rate - rate) * low_pass_weight(self.options.rate_cutoff_hz, dt_s),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Quaternion, UnitQuaternion};
    use proptest::prelude::*;

    const DT_S: f64 = 1.0 / 60.0;

    fn estimator() -> Estimator {
        Estimator::new(EstimatorOptions::default())
    }

    fn vector3(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-bound..bound).prop_map(Vector3::from)
    }

    /// The same attitude with the opposite sign of the quaternion.
    fn negated(attitude: Attitude) -> Attitude {
        let q = attitude.unit_quaternion().quaternion();
        Attitude::from_unit_quaternion(UnitQuaternion::new_unchecked(Quaternion::from(-q.coords)))
    }

    #[test]
    fn nothing_is_known_before_the_first_pose_and_no_rates_after_it() {
        let mut estimator = estimator();
        assert_eq!(estimator.latest(), Estimate::default());
        let estimate = estimator.update(3.0, Vector3::new(1.0, 2.0, 3.0), Attitude::LEVEL);
        assert_eq!(
            estimate,
            Estimate { position: Vector3::new(1.0, 2.0, 3.0), ..Estimate::default() }
        );
        assert_eq!(estimator.latest(), estimate);
    }

    #[test]
    fn velocity_rises_as_a_first_order_lag_at_the_cutoff() {
        let mut estimator = estimator();
        estimator.update(0.0, Vector3::zeros(), Attitude::LEVEL);
        let time_constant_s = 1.0 / (std::f64::consts::TAU * 6.0);
        let steps = 10;
        let mut estimate = Estimate::default();
        for k in 1..=steps {
            let t_s = time_constant_s * f64::from(k) / f64::from(steps);
            estimate = estimator.update(t_s, Vector3::new(t_s, 0.0, 0.0), Attitude::LEVEL);
        }
        assert!((estimate.velocity.x - (1.0 - (-1.0_f64).exp())).abs() < 1e-9);
    }

    #[test]
    fn rates_are_held_over_a_gap_and_continue_from_there() {
        let mut estimator = estimator();
        for k in 0..60 {
            let t_s = f64::from(k) * DT_S;
            estimator.update(t_s, Vector3::new(t_s, 0.0, 0.0), Attitude::LEVEL);
        }
        let before = estimator.latest().velocity;
        // Displaced by 5 m during the gap.
        let after = estimator.update(3.0, Vector3::new(-5.0, 0.0, 0.0), Attitude::LEVEL);
        assert_eq!(after.velocity, before);
        assert_eq!(after.position.x, -5.0);
        let next =
            estimator.update(3.0 + DT_S, Vector3::new(-5.0 + DT_S, 0.0, 0.0), Attitude::LEVEL);
        assert!((next.velocity - before).norm() < 1e-6);
    }

    #[test]
    fn repeated_earlier_and_non_finite_poses_are_ignored() {
        let mut estimator = estimator();
        estimator.update(1.0, Vector3::zeros(), Attitude::LEVEL);
        let before = estimator.update(1.0 + DT_S, Vector3::new(0.01, 0.0, 0.0), Attitude::LEVEL);
        let away = Vector3::new(9.0, 9.0, 9.0);
        let nan = Attitude::from_rotation_vector(Vector3::new(f64::NAN, 0.0, 0.0));
        estimator.update(1.0 + DT_S, away, Attitude::LEVEL);
        estimator.update(0.5, away, Attitude::LEVEL);
        estimator.update(f64::NAN, away, Attitude::LEVEL);
        estimator.update(2.0, Vector3::new(0.0, f64::INFINITY, 0.0), Attitude::LEVEL);
        estimator.update(2.0, away, nan);
        assert_eq!(estimator.latest(), before);
    }

    #[test]
    fn default_options_pass_and_bad_ones_name_their_key() {
        assert_eq!(EstimatorOptions::default().check(), Ok(()));
        let bad = EstimatorOptions { gap_ms: f64::NAN, ..EstimatorOptions::default() };
        assert_eq!(bad.check().unwrap_err().key, "gap-ms");
    }

    #[test]
    fn an_absurd_pose_is_forgotten_after_a_gap() {
        let mut estimator = estimator();
        estimator.update(0.0, Vector3::repeat(1e308), Attitude::LEVEL);
        for k in 1..=6 {
            let estimate = estimator.update(f64::from(k) * DT_S, Vector3::zeros(), Attitude::LEVEL);
            assert_eq!(estimate.velocity, Vector3::zeros());
        }
        assert_eq!(estimator.latest(), Estimate::default());
    }

    proptest! {
        #[test]
        fn constant_motion_is_found_for_any_spacing_of_the_poses(
            velocity in vector3(3.0),
            rate in vector3(3.0),
            spacing_s in prop::collection::vec(0.001..0.049, 100),
        ) {
            let mut estimator = estimator();
            let mut t_s = 0.0;
            for dt_s in spacing_s.iter().cycle().take(400) {
                t_s += dt_s;
                estimator.update(t_s, velocity * t_s, Attitude::from_rotation_vector(rate * t_s));
            }
            let estimate = estimator.latest();
            prop_assert!((estimate.velocity - velocity).norm() < 1e-6);
            prop_assert!((estimate.rate.0 - rate).norm() < 1e-6);
        }

        #[test]
        fn sign_of_the_quaternion_does_not_matter(
            turns in prop::collection::vec((vector3(1.0), any::<bool>()), 2..30),
        ) {
            let (mut plain, mut flipping) = (estimator(), estimator());
            let mut attitude = Attitude::LEVEL;
            for (k, (turn, flip)) in (0_u32..).zip(&turns) {
                attitude = attitude.turned_by(*turn);
                let t_s = f64::from(k) * DT_S;
                plain.update(t_s, Vector3::zeros(), attitude);
                let written = if *flip { negated(attitude) } else { attitude };
                flipping.update(t_s, Vector3::zeros(), written);
                let difference = plain.latest().rate.0 - flipping.latest().rate.0;
                prop_assert!(difference.norm() < 1e-9);
            }
        }
    }
}
