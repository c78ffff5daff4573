//! The doubt about a pose that was believed for the uncertainty of the prediction, as after a gap.
//!
//! Such a pose may be of another body, or of markers that were exchanged: then its offset from the motion predicted without it
//! stays the same. An offset that a force made grows, because the force gave the vehicle a velocity, too.

use oqtal_control::predictive::{MeasuredPose, Surroundings, Track};

use super::stranger::Stranger;

/// Time for which an offset must stay the same \[s\].
const DOUBT_S: f64 = 0.1;

/// A believed pose that is doubted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt {
    /// The motion predicted without the doubted pose and those after it.
    without: Track,
    /// The doubted pose relative to it.
    first: Stranger,
    /// When it was measured \[s\].
    since_s: f64,
}

/// What a further pose tells about a doubt.
#[derive(Clone, Copy, Debug)]
pub(super) enum DoubtVerdict {
    /// Nothing yet.
    Open(Doubt),
    /// The doubted pose was right.
    Settled,
    /// The doubted pose and those after it are of another body: the motion without them, and this pose relative to it.
    Relabel(Track, Stranger),
}

impl Doubt {
    /// The doubt about `pose`, measured at the instant of `expected`; `None` if the pose is where it was expected.
    pub(super) fn about(expected: &Track, pose: &MeasuredPose) -> Option<Self> {
        let first = Stranger::of(expected, pose);
        first.is_off().then_some(Self { without: *expected, first, since_s: expected.t_s })
    }

    /// The motion predicted for `t_s` \[s\] without the doubted poses.
    pub(super) fn without(&self, t_s: f64, surroundings: &Surroundings) -> Track {
        self.without.advanced(t_s, surroundings)
    }

    /// The verdict of `pose`, for the motion `without` at its instant.
    pub(super) fn judge(&self, without: &Track, pose: &MeasuredPose) -> DoubtVerdict {
        let now = Stranger::of(without, pose);
        if !now.stays(&self.first) {
            return DoubtVerdict::Settled;
        }
        match without.t_s - self.since_s >= DOUBT_S {
            true => DoubtVerdict::Relabel(*without, now),
            false => DoubtVerdict::Open(Self { without: *without, ..*self }),
        }
    }
}
