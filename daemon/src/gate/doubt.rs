//! The doubt about a pose that was believed although it was off the prediction.
//!
//! Such a pose may be an outlier: then the poses after it return to the motion predicted without it. After a gap, in which the
//! uncertainty has grown, it may be of another body, or of markers that were exchanged: then its offset from that motion stays the
//! same. An offset that a force made during the gap grows, because the force gave the vehicle a velocity, too: by at
//! least the share of itself that the time since is of the gap.

use oqtal_control::predictive::{MeasuredPose, Surroundings, Track};

use super::stranger::Stranger;

/// Time for which a doubt lasts, and an offset must stay the same \[s\].
const DOUBT_S: f64 = 0.1;
/// Least gap after which an offset may be that of another body \[s\]: two frames lost at 60 Hz. Without one the gate is narrow.
const LEAST_GAP_S: f64 = 0.055;

/// A believed pose that is doubted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt {
    /// The motion predicted without the doubted pose and those after it.
    without: Track,
    /// The doubted pose relative to it.
    first: Stranger,
    /// When it was measured \[s\].
    since_s: f64,
    /// Time between the last pose before the doubt and the doubted one \[s\].
    gap_s: f64,
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
    /// The doubt about a pose that is `first` relative to `expected`, after a gap of `gap_s` \[s\]; `None` if the pose is where it
    /// was expected.
    pub(super) fn about(expected: &Track, first: Stranger, gap_s: f64) -> Option<Self> {
        first.is_off().then_some(Self { without: *expected, first, since_s: expected.t_s, gap_s })
    }

    /// The motion predicted for `t_s` \[s\] without the doubted poses.
    pub(super) fn without(&self, t_s: f64, surroundings: &Surroundings) -> Track {
        self.without.advanced(t_s, surroundings)
    }

    /// The verdict of `pose`, for the motion `without` at its instant.
    pub(super) fn judge(&self, without: &Track, pose: &MeasuredPose) -> DoubtVerdict {
        let now = Stranger::of(without, pose);
        let elapsed_s = without.t_s - self.since_s;
        if elapsed_s < DOUBT_S {
            return DoubtVerdict::Open(Self { without: *without, ..*self });
        }
        let is_after_gap = self.gap_s >= LEAST_GAP_S;
        if is_after_gap && now.stays(&self.first, elapsed_s / self.gap_s) {
            DoubtVerdict::Relabel(*without, now)
        } else {
            DoubtVerdict::Settled
        }
    }
}
