//! A pose relative to the predicted motion, and how such poses resemble each other.

use nalgebra::Vector3;
use oqtal_control::predictive::{Deviation, MeasuredPose, Track};

/// Distance within which two poses agree, each relative to the predicted motion \[m\].
const AGREED_M: f64 = 0.015;
/// Angle within which they agree \[rad\].
const AGREED_RAD: f64 = 0.05;
/// Share of the greater offset within which they agree if that is more \[-\]: a prediction by a wrong model moves on.
const AGREED_SHARE: f64 = 0.15;

/// Offset from the predicted motion from which on it is compared with later ones \[m\].
const OFFSET_M: f64 = 0.03;
/// The same of the attitude \[rad\].
const OFFSET_RAD: f64 = 0.1;
/// Change of an offset that counts as none, as a share of it \[-\]. What moved a vehicle during a short gap also gave it a velocity,
/// so that the offset grows by half of itself and more within the time of a doubt.
const SAME_SHARE: f64 = 0.3;
/// The same over the growth of an offset by a constant velocity since the gap began \[-\]: half way from an offset that stays. After
/// a long gap that growth is small.
const SAME_GROWTH: f64 = 0.5;

/// A pose relative to the predicted motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Stranger(pub(super) Deviation);

impl Stranger {
    /// `pose` relative to `expected`.
    pub(super) fn of(expected: &Track, pose: &MeasuredPose) -> Self {
        Self(expected.deviation(pose))
    }

    /// Distance of the pose from the predicted position \[m\].
    pub(super) fn distance_m(&self) -> f64 {
        self.0.offset.norm()
    }

    /// Angle of the pose from the predicted attitude \[rad\].
    pub(super) fn turn_rad(&self) -> f64 {
        self.0.turn.norm()
    }

    /// Whether both are poses of one body, as far as one frame after the other tells.
    pub(super) fn agrees(&self, other: &Self) -> bool {
        let alike = |a: &Vector3<f64>, b: &Vector3<f64>, least: f64| {
            (a - b).norm() <= least.max(AGREED_SHARE * a.norm().max(b.norm()))
        };
        alike(&self.0.offset, &other.0.offset, AGREED_M)
            && alike(&self.0.turn, &other.0.turn, AGREED_RAD)
    }

    /// Whether the pose is off the predicted motion by more than noise.
    pub(super) fn is_off(&self) -> bool {
        !self.agrees(&Self::default())
    }

    /// Whether the offset from the prediction is a large one and has not changed since `first`, for a time of `growth` gaps
    /// \[-\]. A body that only moved is told from a moving one by less than one that turned, too: no force turns a vehicle and then
    /// leaves it there.
    pub(super) fn stays(&self, first: &Self, growth: f64) -> bool {
        let share = |now: &Vector3<f64>, first: &Vector3<f64>, least: f64| {
            (first.norm() >= least).then(|| (now - first).norm() / first.norm())
        };
        let moved = share(&self.0.offset, &first.0.offset, OFFSET_M);
        match share(&self.0.turn, &first.0.turn, OFFSET_RAD) {
            Some(turned) => moved.unwrap_or(0.0).max(turned) <= SAME_SHARE,
            None => moved.is_some_and(|moved| moved <= SAME_SHARE.min(SAME_GROWTH * growth)),
        }
    }
}
