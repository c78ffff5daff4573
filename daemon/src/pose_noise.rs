//! Whether a source of poses ever repeats a pose: one with noise does not, one with coarse numbers or without noise may.

use oqtal_control::predictive::MeasuredPose;

/// Weight of a pose in the share of repeated ones \[-\].
const REPEATED_WEIGHT: f64 = 0.01;
/// Weight of a step in the mean step \[-\].
const STEP_WEIGHT: f64 = 0.1;
/// Share of repeated poses up to which a source counts as one that never repeats a pose \[-\]: none in the last seconds.
const NEVER: f64 = 0.003;
/// Mean step from pose to pose from which on it has noise or the vehicle moves \[m\] or \[rad\]; less is the rest of a decay.
const LEAST_STEP: f64 = 1e-5;
/// Share of the mean step that the least step of a component reaches if the source has noise \[-\]; the steps of coarse numbers and
/// of a smooth motion are all alike.
const NOISE_SHARE: f64 = 0.2;
/// Growth of the least step from pose to pose, by which an old one is forgotten \[-\].
const FORGETTING: f64 = 1.02;
/// Repetitions in a row that such a source does not make \[-\].
const IMPOSSIBLE_REPEATS: u32 = 2;

/// Averages over the poses of a source.
#[derive(Clone, Copy, Debug)]
pub struct PoseNoise {
    last: Option<MeasuredPose>,
    /// Repetitions of the last pose \[-\].
    repeats: u32,
    /// Share of poses that were repeated, without the last one \[0..1\].
    repeated: f64,
    /// Mean step from pose to pose, the larger of both \[m\] or \[rad\].
    step: f64,
    /// The least change of a coordinate lately \[m\].
    least: f64,
}

impl Default for PoseNoise {
    /// A source without a pose yet.
    fn default() -> Self {
        Self { last: None, repeats: 0, repeated: 0.0, step: 0.0, least: 1.0 }
    }
}

impl PoseNoise {
    /// Takes the next pose, whether it is believed or not.
    pub fn take(&mut self, pose: &MeasuredPose) {
        let Some(last) = self.last.replace(*pose) else { return };
        if last == *pose {
            self.repeats = self.repeats.saturating_add(1);
            return;
        }
        let was_repeated = f64::from(u8::from(self.repeats > 0));
        self.repeated += REPEATED_WEIGHT * (was_repeated - self.repeated);
        let moved = (pose.position - last.position).norm();
        let changes = (pose.position - last.position).map(f64::abs);
        let least = changes.iter().copied().filter(|change| *change > 0.0).fold(1.0, f64::min);
        self.least = (self.least * FORGETTING).min(least);
        let step = moved.max(last.attitude.angle_to(&pose.attitude)).min(1.0);
        self.step += STEP_WEIGHT * (step - self.step);
        self.repeats = 0;
    }

    /// Repetitions of the last pose \[-\].
    #[must_use]
    pub fn repeats(&self) -> u32 {
        self.repeats
    }

    /// Whether the source repeats its pose although its poses have always changed.
    #[must_use]
    pub fn is_frozen(&self) -> bool {
        let has_noise = self.step > LEAST_STEP && self.least < NOISE_SHARE * self.step;
        self.repeats >= IMPOSSIBLE_REPEATS && self.repeated < NEVER && has_noise
    }
}
