//! Residual of a pose: its offset and turn relative to the predicted motion, and the comparison of residuals.

use nalgebra::Vector3;
use oqtal_control::predictive::{Deviation, MeasuredPose, Track};

use crate::measured_noise::PoseDeviations;

/// Distance within which two residuals match \[m\].
const MATCH_M: f64 = 0.015;
/// Angle within which two residuals match \[rad\].
const MATCH_RAD: f64 = 0.05;
/// Share of the greater residual within which two match if that is more \[-\]: the prediction of a wrong model drifts.
const MATCH_SHARE: f64 = 0.15;

/// Least offset that is compared with later ones \[m\].
const OFFSET_M: f64 = 0.03;
/// Least turn that is compared with later ones \[rad\].
const OFFSET_RAD: f64 = 0.1;
/// Greatest change of a constant residual, as a share of it \[-\]. A force that moved a vehicle during a short gap also gave it a
/// velocity, so that the offset grows by half of itself and more within the time of a hypothesis.
const CONSTANT_SHARE: f64 = 0.3;
/// The same over the growth of an offset by a constant velocity since the gap began \[-\]: half of that growth. After a long gap the
/// growth is small.
const CONSTANT_GROWTH: f64 = 0.5;

/// Standard deviations of the measured noise within which two residuals match if that is more \[-\].
const MATCH_SIGMA: f64 = 5.0;

/// Distance and angle within which two residuals match.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Distance \[m\].
    offset: f64,
    /// Angle \[rad\].
    turn: f64,
}

impl Default for Tolerance {
    /// Tolerance for poses with little noise.
    fn default() -> Self {
        Self { offset: MATCH_M, turn: MATCH_RAD }
    }
}

impl Tolerance {
    /// Tolerance for poses with this noise.
    pub(super) fn of(noise: &PoseDeviations) -> Self {
        Self {
            offset: MATCH_M.max(MATCH_SIGMA * noise.position_m),
            turn: MATCH_RAD.max(MATCH_SIGMA * noise.attitude_rad),
        }
    }
}

/// A pose relative to the predicted motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PoseResidual(pub(super) Deviation);

impl PoseResidual {
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

    /// Whether both are residuals of one body within `tolerance`, one frame after the other.
    pub(super) fn matches(&self, other: &Self, tolerance: &Tolerance) -> bool {
        let are_alike = |a: &Vector3<f64>, b: &Vector3<f64>, least: f64| {
            (a - b).norm() <= least.max(MATCH_SHARE * a.norm().max(b.norm()))
        };
        are_alike(&self.0.offset, &other.0.offset, tolerance.offset)
            && are_alike(&self.0.turn, &other.0.turn, tolerance.turn)
    }

    /// Whether the residual exceeds `tolerance`.
    pub(super) fn is_significant(&self, tolerance: &Tolerance) -> bool {
        !self.matches(&Self::default(), tolerance)
    }

    /// Whether the residual is large and has not changed since `first`, for a time of `growth` gaps \[-\]. A body that only moved may
    /// have changed less than one that also turned: no force turns a vehicle and then leaves it there.
    pub(super) fn is_constant_since(&self, first: &Self, growth: f64) -> bool {
        let share = |now: &Vector3<f64>, first: &Vector3<f64>, least: f64| {
            (first.norm() >= least).then(|| (now - first).norm() / first.norm())
        };
        let moved = share(&self.0.offset, &first.0.offset, OFFSET_M);
        match share(&self.0.turn, &first.0.turn, OFFSET_RAD) {
            Some(turned) => moved.unwrap_or(0.0).max(turned) <= CONSTANT_SHARE,
            None => {
                moved.is_some_and(|moved| moved <= CONSTANT_SHARE.min(CONSTANT_GROWTH * growth))
            }
        }
    }
}
