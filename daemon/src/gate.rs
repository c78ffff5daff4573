//! The gate on the innovation: in flight a pose is admitted if the commands sent can have moved the vehicle to it.

mod outlier;
mod residual;
#[cfg(test)]
mod tests;

use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::predictive::{MeasuredPose, MotionTracker, Track};

use crate::floor::LIFTING;
use crate::measured_noise::PoseDeviations;
use crate::pose_noise::PoseNoise;
use outlier::{HypothesisTest, OutlierHypothesis};
use residual::{PoseResidual, Tolerance};

/// Refused poses in a row that match each other and not the motion, after which they count as poses of another body or of swapped
/// markers \[-\].
const RELABEL_POSES: u32 = 3;
/// Greatest angle of a pose from the predicted attitude, independent of its uncertainty \[rad\]. Swapped markers turn a body by more. If
/// the vehicle may have turned by more since the last accepted pose, the flight must not continue.
const GREATEST_TURN_RAD: f64 = 0.5;
/// Greatest innovation of a pose that agrees with the motion without an outlier before it \[standard deviations\].
const HYPOTHESIS_SIGMA: f64 = 3.0;
/// Repetitions of a pose from which on its source may count as frozen \[-\].
const FROZEN_REPEATS: u32 = 2;
/// Predicted motion during which a pose cannot stay the same \[m\]: many times the resolution of a coarse source.
const CHANGED_M: f64 = 0.02;
/// Predicted rotation during which it cannot \[rad\].
const CHANGED_RAD: f64 = 0.06;
/// Longest prediction with which a pose that stays the same is compared, because of the error of the velocity \[s\].
const LONGEST_PREDICTION_S: f64 = 0.15;
/// Time after which a vehicle on the floor must have been lifted by a thrust above [`LIFTING`] \[s\].
const LIFTED_S: f64 = 0.12;

/// The last refused pose.
#[derive(Clone, Copy, Debug)]
struct Refused {
    residual: PoseResidual,
    /// Number of refused poses in a row that match it \[-\].
    poses: u32,
}

/// The gate on the innovation of a tracker's motion.
#[derive(Clone, Debug)]
pub struct MotionGate {
    /// Greatest innovation of a pose that is admitted \[standard deviations\].
    sigma: f64,
    /// The instant of the last admitted pose \[s\]: the tracked motion may have been propagated since.
    admitted_s: f64,
    /// The hypothesis about the last admitted pose with a significant residual.
    hypothesis: Option<OutlierHypothesis>,
    /// The motion since which a pose that stays the same is compared with the prediction.
    changed: Option<Track>,
    noise: PoseNoise,
    tolerance: Tolerance,
    refused: Option<Refused>,
}

impl MotionGate {
    /// The gate of `config`, on the ground.
    pub fn new(config: &Config) -> Self {
        Self {
            sigma: config.safety.gate_sigma,
            admitted_s: 0.0,
            hypothesis: None,
            changed: None,
            noise: PoseNoise::default(),
            tolerance: Tolerance::default(),
            refused: None,
        }
    }

    /// Takes the measured noise of the poses.
    pub fn set_noise(&mut self, noise: &PoseDeviations) {
        self.tolerance = Tolerance::of(noise);
    }

    /// Restarts at the beginning or end of a flight, with the motion that `tracker` has then.
    pub fn restart(&mut self, tracker: &MotionTracker) {
        let track = tracker.track();
        (self.hypothesis, self.changed, self.refused) = (None, track.copied(), None);
        self.admitted_s = track.map_or(0.0, |track| track.t_s);
    }

    /// Discards the hypothesis about an outlier: the motion has been propagated past it.
    pub fn discard_hypothesis(&mut self) {
        self.hypothesis = None;
    }

    /// Checks a pose measured at `t_s` \[s\] against the motion of `tracker`, and corrects that motion by it. On the ground every pose
    /// passes.
    ///
    /// # Errors
    /// Why the pose is refused.
    pub fn check(
        &mut self,
        tracker: &mut MotionTracker,
        t_s: f64,
        pose: &MeasuredPose,
    ) -> Result<(), Cause> {
        self.noise.take(pose);
        let Some(mut expected) = tracker.predict(t_s) else { return Ok(()) };
        let mut residual = PoseResidual::of(&expected, pose);
        let mut without = self.hypothesis.map(|found| tracker.advanced(&found.without, t_s));
        if let Some(returned) = without.filter(|track| self.returns_to(track, &residual, pose)) {
            // The pose was an outlier: the motion is that without it.
            (expected, self.hypothesis, without) = (returned, None, None);
            residual = PoseResidual::of(&expected, pose);
        }
        if let Some(held) = self.held_by_floor(tracker, (&expected, &residual), pose) {
            (expected, self.hypothesis, without) = (held, None, None);
            residual = PoseResidual::of(&expected, pose);
        }
        if !self.lies_on(&expected, &residual, self.sigma) {
            let agrees = |track: &Track| {
                self.lies_on(track, &PoseResidual::of(track, pose), HYPOTHESIS_SIGMA)
            };
            expected = without.filter(agrees).ok_or_else(|| self.refuse(residual))?;
            residual = PoseResidual::of(&expected, pose);
        }
        if self.is_frozen(tracker, t_s) {
            return Err(Cause::Frozen);
        }
        let hypothesis = self.test_hypothesis(tracker, without, pose)?;
        let gap_s = t_s - self.admitted_s;
        let is_significant = residual.is_significant(&self.tolerance);
        self.hypothesis = hypothesis.or_else(|| {
            is_significant.then(|| OutlierHypothesis::about(&expected, residual, gap_s))
        });
        self.refused = None;
        tracker.correct(&expected, &residual.0, pose);
        self.admitted_s = t_s;
        let is_over = self.changed.is_none_or(|changed| t_s - changed.t_s > LONGEST_PREDICTION_S);
        if self.noise.repeats() == 0 || is_over || may_stand(tracker, &expected) {
            self.changed = tracker.track().copied();
        }
        Ok(())
    }

    /// Tests the hypothesis about the last poses by `pose`; `without` is the motion without them. Returns it if it is pending.
    fn test_hypothesis(
        &mut self,
        tracker: &mut MotionTracker,
        without: Option<Track>,
        pose: &MeasuredPose,
    ) -> Result<Option<OutlierHypothesis>, Cause> {
        let Some((hypothesis, without)) = self.hypothesis.zip(without) else { return Ok(None) };
        match hypothesis.test(&without, pose) {
            HypothesisTest::Pending => Ok(Some(hypothesis)),
            HypothesisTest::Rejected => Ok(None),
            HypothesisTest::OtherBody(residual) => {
                tracker.restore(without);
                self.refused = Some(Refused { residual, poses: RELABEL_POSES });
                self.hypothesis = None;
                Err(Cause::Relabel)
            }
        }
    }

    /// Whether a pose with this residual agrees with the motion `expected` within `sigma` standard deviations, and does not match
    /// the poses refused before it: a growing covariance does not readmit a refused pose. After poses of another body, a pose is
    /// admitted only at the predicted position of the vehicle.
    fn lies_on(&self, expected: &Track, residual: &PoseResidual, sigma: f64) -> bool {
        let is_refused = self.refused.is_some_and(|refused| match refused.poses {
            RELABEL_POSES.. => residual.is_significant(&self.tolerance),
            _ => refused.residual.matches(residual, &self.tolerance),
        });
        // A comparison with NaN is false.
        expected.innovation(&residual.0).sigma() <= sigma
            && residual.turn_rad() <= GREATEST_TURN_RAD
            && !is_refused
    }

    /// Whether `pose` lies on the motion `without` an outlier, and nearer to it than to the motion with it, from which it has
    /// `residual`.
    fn returns_to(&self, without: &Track, residual: &PoseResidual, pose: &MeasuredPose) -> bool {
        let other = PoseResidual::of(without, pose);
        !other.is_significant(&self.tolerance) && other.distance_m() < residual.distance_m()
    }

    /// The motion of a vehicle that the floor holds, if `pose` agrees better with it than with the motion `expected`, from which it has
    /// `residual`: the prediction does not contain the floor, and a vehicle that rests on it is not another body.
    fn held_by_floor(
        &self,
        tracker: &MotionTracker,
        (expected, residual): (&Track, &PoseResidual),
        pose: &MeasuredPose,
    ) -> Option<Track> {
        let before = tracker.track().filter(|_| may_stand(tracker, expected))?;
        let sigma = |track: &Track, residual: &PoseResidual| track.innovation(&residual.0).sigma();
        let expected_sigma = sigma(expected, residual);
        let held = expected.held_since(before, tracker.floor_m());
        let agrees_better = sigma(&held, &PoseResidual::of(&held, pose)) < expected_sigma;
        let is_unexpected = expected_sigma > self.sigma || residual.is_significant(&self.tolerance);
        (agrees_better && is_unexpected).then_some(held)
    }

    /// Records a refused pose, and returns why.
    fn refuse(&mut self, residual: PoseResidual) -> Cause {
        let poses = match self.refused {
            Some(refused) if refused.poses >= RELABEL_POSES => RELABEL_POSES,
            Some(refused) if refused.residual.matches(&residual, &self.tolerance) => {
                refused.poses + 1
            }
            _ => 1,
        };
        self.refused = Some(Refused { residual, poses });
        if poses >= RELABEL_POSES { Cause::Relabel } else { Cause::Jump }
    }

    /// Whether the pose stays the same, up to `t_s` \[s\], although it must have changed: because of its noise, or because of the
    /// motion predicted without the poses that stayed the same.
    fn is_frozen(&self, tracker: &MotionTracker, t_s: f64) -> bool {
        let Some(before) = self.changed.as_ref().filter(|_| self.noise.repeats() >= FROZEN_REPEATS)
        else {
            return false;
        };
        if self.noise.is_frozen() {
            return true;
        }
        let after = tracker.advanced(before, t_s);
        let (from, to) = (&before.motion, &after.motion);
        let is_lifted = after.is_at_floor(tracker.floor_m()) && t_s - before.t_s > LIFTED_S;
        is_lifted
            || (to.position - from.position).norm() > CHANGED_M
            || from.attitude.angle_to(&to.attitude) > CHANGED_RAD
    }
}

/// Whether the vehicle may stand on the floor: it is at the floor, and its thrust need not lift it.
fn may_stand(tracker: &MotionTracker, track: &Track) -> bool {
    let weight_n = tracker.model().mass_kg * tracker.model().gravity_m_s2;
    track.is_at_floor(tracker.floor_m()) && track.motion.thrust_n < LIFTING * weight_n
}
