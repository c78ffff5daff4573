//! Detects whether a pose source ever repeats a pose: a source with noise does not; one with coarse numbers or without noise may.

use oqtal_control::predictive::MeasuredPose;

/// Weight of a step in the mean step \[-\].
const STEP_WEIGHT: f64 = 0.1;
/// Share of repeated poses up to which a source counts as one that never repeats a pose \[-\].
const NEVER: f64 = 0.003;
/// Mean step from pose to pose above which positions have noise or the vehicle moves \[m\]; a smaller step is the end of a decay.
const LEAST_STEP_M: f64 = 1e-5;
/// Share of the mean step that the least change of a coordinate stays below if positions have noise \[-\]: coarse numbers and a
/// smooth motion change by steps that are all alike.
const NOISE_SHARE: f64 = 0.2;
/// Growth of the least change from pose to pose, so that an old minimum loses its effect \[-\].
const FORGETTING: f64 = 1.02;
/// Repetitions in a row that a source with noise does not make \[-\].
const IMPOSSIBLE_REPEATS: u32 = 2;

/// Figures of the poses of a source.
#[derive(Clone, Copy, Debug)]
pub struct PoseNoise {
    last: Option<MeasuredPose>,
    /// Repetitions of the last pose \[-\].
    repeats: u32,
    /// Poses that differed from the one before \[-\].
    changed: u64,
    /// Poses that repeated the one before, without the last run of them \[-\]. All since the start: a source of coarse numbers
    /// repeats its poses at rest and not in fast flight, and rests again.
    repeated: u64,
    /// Mean step from pose to pose \[m\].
    step_m: f64,
    /// The least change of a coordinate lately \[m\].
    least_m: f64,
}

impl Default for PoseNoise {
    /// A source without a pose yet.
    fn default() -> Self {
        Self { last: None, repeats: 0, changed: 0, repeated: 0, step_m: 0.0, least_m: 1.0 }
    }
}

impl PoseNoise {
    /// Takes the next pose, whether it is admitted or not.
    pub fn take(&mut self, pose: &MeasuredPose) {
        let Some(last) = self.last.replace(*pose) else { return };
        if last == *pose {
            self.repeats = self.repeats.saturating_add(1);
            return;
        }
        self.changed += 1;
        self.repeated += u64::from(std::mem::take(&mut self.repeats));
        let moved = pose.position - last.position;
        let changes = moved.iter().map(|change| change.abs());
        let least_m = changes.filter(|change| *change > 0.0).fold(1.0, f64::min);
        self.least_m = (self.least_m * FORGETTING).min(least_m);
        self.step_m += STEP_WEIGHT * (moved.norm().min(1.0) - self.step_m);
    }

    /// Repetitions of the last pose \[-\].
    pub fn repeats(&self) -> u32 {
        self.repeats
    }

    /// Whether the source repeats its pose, although its poses had always changed before.
    pub fn is_frozen(&self) -> bool {
        let has_noise = self.step_m > LEAST_STEP_M && self.least_m < NOISE_SHARE * self.step_m;
        let never_repeats = self.repeated as f64 <= NEVER * self.changed as f64;
        self.repeats >= IMPOSSIBLE_REPEATS && never_repeats && has_noise
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use oqtal_control::quaternion::Attitude;

    use super::*;

    fn at(x: f64, y: f64) -> MeasuredPose {
        MeasuredPose { position: Vector3::new(x, y, 1.0), attitude: Attitude::LEVEL }
    }

    /// `poses` poses of a vehicle that flies at 1.2 m/s.
    fn fly(noise: &mut PoseNoise, poses: u32, quantum_m: f64) {
        for index in 0..poses {
            let x = 0.02 * f64::from(index);
            let y = 0.003 * (0.1 * f64::from(index)).sin();
            let coarse = |value: f64| (value / quantum_m).round() * quantum_m;
            noise.take(&at(coarse(x), coarse(y)));
        }
    }

    #[test]
    fn coarse_numbers_that_repeat_at_rest_are_not_frozen_after_a_fast_flight() {
        let mut noise = PoseNoise::default();
        (0..60).for_each(|_| noise.take(&at(0.0, 0.0)));
        fly(&mut noise, 1200, 1e-3);
        (0..10).for_each(|_| noise.take(&at(24.0, 0.0)));
        assert!(noise.repeats() > IMPOSSIBLE_REPEATS && !noise.is_frozen());
    }

    #[test]
    fn a_source_whose_poses_have_always_changed_is_frozen_when_it_repeats_one() {
        let mut noise = PoseNoise::default();
        fly(&mut noise, 100, 1e-7);
        let last = at(2.0, 0.001);
        noise.take(&last);
        noise.take(&last);
        assert!(!noise.is_frozen());
        noise.take(&last);
        assert!(noise.is_frozen());
    }
}
