//! Tests whether the rotation seen by the cameras follows the rotation of the vehicle.

use nalgebra::Vector3;

use super::rotation_pair::RotationPair;

/// Accuracy of the rotation with which poses are compared.
#[derive(Clone, Copy, Debug)]
pub(super) struct ResponseLimit {
    /// Least rotation seen over that of the vehicle at which poses follow it \[-\].
    share: f64,
    /// Square of a rotation, over the variance of agreeing ones, that is not evidence \[-\]: a vehicle follows the slow noise of its
    /// poses, which then show no rotation.
    margin: f64,
}

impl ResponseLimit {
    /// Limit for the rotation measured by the gyroscope.
    pub(super) const GYROSCOPE: Self = Self { share: 0.3, margin: 1.5 };
    /// Limit for the rotation predicted from the commands: the vehicle may have only half of the configured authority, and another lag and
    /// delay.
    pub(super) const COMMANDS: Self = Self { share: 0.2, margin: 3.0 };
}

/// Rate at which evidence is counted \[1/s\]: samples closer together share their noise.
const COUNTS_PER_S: f64 = 60.0;

/// Driven rotation from which on samples have more weight \[rad\]; a law rarely demands it as long as the poses follow the vehicle.
const LARGE_RAD: f64 = 0.08;
/// Greatest weight of a large rotation \[-\].
const GREATEST_WEIGHT: f64 = 6.0;

/// Bounds of the evidence of a sample \[-\], so that an outlier of the poses is one sample: the lower one is that of poses that
/// follow the gyroscope.
const LEAST_SAMPLE: f64 = -0.7;
const GREATEST_SAMPLE: f64 = 1.0;

/// Longest interval that counts \[s\]: after a gap one sample is still one.
const LONGEST_S: f64 = 0.035;

/// Log-likelihood ratio above which the rotation seen is that of the vehicle \[-\].
const CONFIRMED: f64 = 7.0;

/// Sum of evidence about each axis that the rotation `seen` is not that of the vehicle, and that it is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ResponseTest {
    sums: Vector3<f64>,
    /// Log-likelihood ratio of a rotation that is seen and of one that is not \[-\].
    confirmation: f64,
    /// Time since the poses were last found to follow the vehicle \[s\].
    unconfirmed_s: f64,
}

impl ResponseTest {
    /// Takes rotations that are washed out; their difference has the variance `variance` \[rad^2\] about each axis while they agree.
    /// Returns the greatest sum \[-\].
    pub(super) fn take(
        &mut self,
        &RotationPair { seen, driven, dt_s, .. }: &RotationPair,
        limit: &ResponseLimit,
        variance: f64,
    ) -> f64 {
        let likelihood = (seen - driven * 0.5).dot(&driven) / variance;
        let counts = COUNTS_PER_S * dt_s.min(LONGEST_S);
        self.confirmation = (self.confirmation + likelihood.clamp(-1.0, 1.0) * counts).max(0.0);
        self.unconfirmed_s += dt_s;
        if self.confirmation > CONFIRMED {
            (self.confirmation, self.unconfirmed_s) = (0.0, 0.0);
        }
        for axis in 0..3 {
            let (seen, driven) = (seen[axis], driven[axis]);
            let square = driven * driven;
            let unseen = limit.share * square - limit.margin * variance;
            let weight = (square / (LARGE_RAD * LARGE_RAD)).clamp(1.0, GREATEST_WEIGHT);
            let sample = (unseen - seen * driven) / (variance + square);
            let sample = sample.clamp(LEAST_SAMPLE, GREATEST_SAMPLE);
            self.sums[axis] = (self.sums[axis] + sample * weight * counts).max(0.0);
        }
        self.sums.max()
    }

    /// Time since the poses were last found to follow the vehicle \[s\].
    pub(super) fn unconfirmed_s(&self) -> f64 {
        self.unconfirmed_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outlier_of_the_poses_is_one_sample() {
        let mut test = ResponseTest::default();
        let (seen, driven) = (Vector3::z() * -0.07, Vector3::z() * 0.009);
        let pair = RotationPair { seen, driven, t_s: 1.0, dt_s: 1.0 / 60.0 };
        let sum = test.take(&pair, &ResponseLimit::GYROSCOPE, 2e-5);
        assert!((0.5..=1.0).contains(&sum), "{sum}");
    }
}
