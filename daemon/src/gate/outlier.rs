//! Hypothesis that an admitted pose with a significant residual was an outlier.
//!
//! If it was an outlier, the poses after it return to the motion predicted without it. After a gap, in which the uncertainty has
//! grown, it may also be a pose of another body or of swapped markers: then its offset from that motion is constant. An offset by
//! a force during the gap grows, because the force also changed the velocity: its relative growth is at least the time since the
//! gap over the duration of the gap.

use oqtal_control::predictive::{MeasuredPose, Track};

use super::residual::PoseResidual;

/// Duration of a hypothesis, during which an offset must stay the same \[s\].
const DURATION_S: f64 = 0.1;
/// Least gap after which an offset may be that of another body \[s\]: two frames lost at 60 Hz. Without one the gate is narrow.
const LEAST_GAP_S: f64 = 0.055;

/// Hypothesis that an admitted pose was an outlier.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutlierHypothesis {
    /// The motion at the instant of that pose, predicted without it.
    pub(super) without: Track,
    /// Residual of the pose.
    first: PoseResidual,
    /// Time between the pose and the one before it \[s\].
    gap_s: f64,
}

/// Result of the test of a hypothesis by a further pose.
#[derive(Clone, Copy, Debug)]
pub(super) enum HypothesisTest {
    /// Neither confirmed nor rejected yet.
    Pending,
    /// The pose was right.
    Rejected,
    /// The pose and those after it are of another body: the present residual, relative to the motion without them.
    OtherBody(PoseResidual),
}

impl OutlierHypothesis {
    /// The hypothesis about a pose with the significant residual `first` from `expected`, after a gap of `gap_s` \[s\].
    pub(super) fn about(expected: &Track, first: PoseResidual, gap_s: f64) -> Self {
        Self { without: *expected, first, gap_s }
    }

    /// Tests the hypothesis by `pose`, for the motion `expected` without the outlier at the instant of the pose.
    pub(super) fn test(&self, expected: &Track, pose: &MeasuredPose) -> HypothesisTest {
        let residual = PoseResidual::of(expected, pose);
        let elapsed_s = expected.t_s - self.without.t_s;
        if elapsed_s < DURATION_S {
            return HypothesisTest::Pending;
        }
        let is_after_gap = self.gap_s >= LEAST_GAP_S;
        if is_after_gap && residual.is_constant_since(&self.first, elapsed_s / self.gap_s) {
            HypothesisTest::OtherBody(residual)
        } else {
            HypothesisTest::Rejected
        }
    }
}
