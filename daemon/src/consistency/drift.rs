//! Tests whether the angle seen by the cameras departs from that of the vehicle.

use nalgebra::Vector3;

use super::rotation_pair::RotationPair;

/// Time constant of the estimated bias of the vehicle's rate \[s\]; at the beginning, the time since then.
const BIAS_S: f64 = 20.0;
/// Time for which the bias is estimated before the test begins \[s\].
const LEARNED_S: f64 = 3.0;
/// Time constant of the low-pass on the difference \[s\].
const SMOOTHING_S: f64 = 0.25;
/// Standard deviations of the noise of the attitude that are added to the limit \[-\].
const LIMIT_SIGMA: f64 = 4.0;
/// Share of the limit below which a difference is attributed to the bias \[-\].
const LEARNED: f64 = 0.5;

/// Accuracy of the rotation with which poses are compared.
#[derive(Clone, Copy, Debug)]
pub(super) struct DriftLimit {
    /// Time constant with which a difference of the angles decays \[s\].
    decay_s: f64,
    /// Difference of the angles that counts as drift \[rad\].
    angle_rad: f64,
    /// Share of the recently seen angle that is added to `angle_rad` \[-\], for errors of scale and alignment.
    share: f64,
}

impl DriftLimit {
    /// Limit for the rotation measured by the gyroscope: 1.7 deg over some seconds.
    pub(super) const GYROSCOPE: Self = Self { decay_s: 8.0, angle_rad: 0.03, share: 0.15 };
    /// Limit for the rotation predicted from the commands: a vehicle may have only half of the configured rate authority, and wind may turn
    /// it.
    pub(super) const COMMANDS: Self = Self { decay_s: 2.0, angle_rad: 0.16, share: 1.5 };
}

/// Difference of the angles by cameras and vehicle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DriftTest {
    bias: Vector3<f64>,
    /// Time of the test \[s\].
    elapsed_s: f64,
    difference: Vector3<f64>,
    smooth: Vector3<f64>,
    /// Angle seen lately \[rad\].
    seen: Vector3<f64>,
}

impl DriftTest {
    /// Takes the rotations of an interval; `deviation_rad` is the noise of the attitude \[rad\]. Returns the greatest difference over its
    /// limit \[-\].
    pub(super) fn take(
        &mut self,
        &RotationPair { seen, driven, dt_s, .. }: &RotationPair,
        limit: &DriftLimit,
        deviation_rad: f64,
    ) -> f64 {
        self.elapsed_s += dt_s;
        let step = seen - driven;
        let decay = (1.0 - dt_s / limit.decay_s).max(0.0);
        self.seen = self.seen * decay + seen;
        self.difference = self.difference * decay + step - self.bias * dt_s;
        if self.elapsed_s < LEARNED_S {
            self.difference = Vector3::zeros();
        }
        self.smooth += (self.difference - self.smooth) * (dt_s / SMOOTHING_S).min(1.0);
        let limit_rad =
            limit.angle_rad + LIMIT_SIGMA * deviation_rad + limit.share * self.seen.norm();
        let ratio = self.smooth.amax() / limit_rad;
        // A drift is not learned as a bias, once the bias is known.
        if ratio < LEARNED || self.elapsed_s < BIAS_S {
            self.bias += (step - self.bias * dt_s) / self.elapsed_s.clamp(0.5, BIAS_S);
        }
        ratio
    }

    /// Restarts the test with the estimated bias.
    pub(super) fn restart(&mut self) {
        let Self { bias, elapsed_s, .. } = *self;
        *self = Self { bias, elapsed_s, ..Self::default() };
    }
}
