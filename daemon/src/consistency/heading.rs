//! Tests whether the heading seen by the cameras follows a small oscillation of the commanded heading.
//!
//! A hovering vehicle hardly rotates, so its poses are hardly tested by its rotation. If the vehicle reports no rates, or if no rotation
//! has confirmed the poses for some time, the heading reference oscillates by `safety.probe-yaw-deg`. The rotations about the vertical body
//! axis, seen by the cameras and driven, are demodulated at the frequency of the oscillation (lock-in detection): noise and wind have
//! little power there, and a law whose poses show no rotation commands more of it, so the evidence grows.

use std::f64::consts::TAU;

use super::rotation_pair::RotationPair;

/// Frequency of the oscillation \[rad/s\]: above the corner of the wash-out, within the bandwidth of every law's yaw loop.
const FREQUENCY_RAD_S: f64 = 0.9 * TAU;
/// Time constant of the demodulation \[s\].
const MEMORY_S: f64 = 0.7;
/// Time from the first oscillation until rotations are compared \[s\].
const SETTLED_S: f64 = 1.2;
/// Share of the driven rotation that must be seen \[-\]: a vehicle with half of the configured authority and longer lags shows more.
const LEAST_SHARE: f64 = 0.25;
/// Shortage of that share, integrated over time, which is the limit \[s\].
const LIMIT_S: f64 = 0.1;
/// Least driven rotation that is evidence, over the amplitude of the reference \[-\].
const LEAST_AMPLITUDE_SHARE: f64 = 0.1;
/// Least driven rotation that is evidence, over the noise of the attitude \[-\].
const LEAST_NOISE_SHARE: f64 = 0.3;
/// Time in which the oscillation begins and ends \[s\].
const RAMP_S: f64 = 0.5;

/// The oscillation of the heading, and the test.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeadingProbe {
    amplitude_rad: f64,
    /// The instant at which the oscillation began \[s\]; `None` while there is none.
    since_s: Option<f64>,
    /// Present amplitude over the configured one \[-\].
    level: f64,
    /// Demodulated rotations, in phase and in quadrature \[rad\].
    seen: [f64; 2],
    driven: [f64; 2],
    /// Shortage of the rotation seen, integrated over time \[s\].
    shortage_s: f64,
}

impl HeadingProbe {
    /// A probe with this amplitude \[rad\]; 0 disables it.
    pub(super) fn new(amplitude_rad: f64) -> Self {
        Self { amplitude_rad, ..Self::default() }
    }

    /// Ends the oscillation.
    pub(super) fn end(&mut self) {
        *self = Self::new(self.amplitude_rad);
    }

    /// Offset of the heading reference at `t_s` \[s\] \[rad\].
    pub(super) fn offset_rad(&self, t_s: f64) -> f64 {
        self.since_s.map_or(0.0, |since_s| {
            self.amplitude_rad * self.level * (FREQUENCY_RAD_S * (t_s - since_s)).sin()
        })
    }

    /// Takes rotations that are washed out; the attitude has the noise `noise_rad` \[rad\]. The heading oscillates while this is `needed`.
    /// Returns the evidence over its limit \[-\].
    pub(super) fn take(&mut self, needed: bool, pair: &RotationPair, noise_rad: f64) -> f64 {
        let &RotationPair { seen, driven, t_s, dt_s } = pair;
        let step = if needed { dt_s } else { -dt_s } / RAMP_S;
        self.level = (self.level + step).clamp(0.0, 1.0);
        if self.amplitude_rad == 0.0 || self.level == 0.0 {
            self.end();
            return 0.0;
        }
        let elapsed_s = t_s - *self.since_s.get_or_insert(t_s);
        let (sine, cosine) = (FREQUENCY_RAD_S * elapsed_s).sin_cos();
        let gain = (dt_s / MEMORY_S).min(1.0);
        for (phase, axis) in [cosine, sine].into_iter().enumerate() {
            self.seen[phase] += (seen.z * axis - self.seen[phase]) * gain;
            self.driven[phase] += (driven.z * axis - self.driven[phase]) * gain;
        }
        let product = |a: &[f64; 2], b: &[f64; 2]| a[0] * b[0] + a[1] * b[1];
        let power = product(&self.driven, &self.driven);
        let least_rad =
            (LEAST_AMPLITUDE_SHARE * self.amplitude_rad).max(LEAST_NOISE_SHARE * noise_rad);
        if elapsed_s > SETTLED_S && power > least_rad * least_rad {
            let share = (product(&self.seen, &self.driven) / power).clamp(-1.0, 1.0);
            self.shortage_s = (self.shortage_s + (LEAST_SHARE - share) * dt_s).max(0.0);
        }
        self.shortage_s / LIMIT_S
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// Rotations about the vertical axis \[rad\] in a period that ends at `t_s` \[s\].
    fn about_z(seen: f64, driven: f64, t_s: f64) -> RotationPair {
        let [seen, driven] = [seen, driven].map(|angle| Vector3::z() * angle);
        RotationPair { seen, driven, t_s, dt_s: 1.0 / 60.0 }
    }

    /// Evidence after `for_s` \[s\] of a rotation seen that is `share` of the driven one, `delay_s` later.
    fn evidence(share: f64, delay_s: f64, for_s: f64) -> f64 {
        let mut probe = HeadingProbe::new(0.03);
        let mut evidence = 0.0;
        for step in 0..(60.0 * for_s) as u32 {
            let t_s = f64::from(step) / 60.0;
            let (seen, driven) = (share * probe.offset_rad(t_s - delay_s), probe.offset_rad(t_s));
            evidence = probe.take(true, &about_z(seen, driven, t_s), 0.003);
        }
        evidence
    }

    #[test]
    fn a_heading_that_follows_late_and_by_half_is_accepted_and_one_that_stays_or_opposes_is_not() {
        assert_eq!(evidence(0.5, 0.1, 20.0), 0.0);
        assert!(evidence(0.0, 0.0, 3.0) > 1.0);
        assert!(evidence(-1.0, 0.0, 2.5) > 1.0);
    }

    #[test]
    fn without_an_amplitude_nothing_oscillates() {
        let mut probe = HeadingProbe::new(0.0);
        assert_eq!(probe.take(true, &about_z(0.0, 1.0, 1.0), 0.003), 0.0);
        assert_eq!(probe.offset_rad(1.2), 0.0);
    }
}
