//! Noise of the poses, measured from the poses alone: a vehicle's motion is smooth over four poses, noise is not.
//!
//! Each pose is compared with the parabola through the three poses before it. The residual has the variance of the noise times one plus the
//! sum of the squared weights of the three, 20 for equal intervals; motion adds its third difference, the jerk times the cube of the
//! interval, 0.1 mm at 23 m/s^3 and 60 Hz. Noise that changes more slowly than over four poses is not measured: filters follow it. The mean
//! is slow, contains no values of the last second and a half, and is not updated while a test raises evidence against the poses, so that a
//! fault does not count as noise.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::predictive::MeasuredPose;
use oqtal_control::quaternion::Attitude;

use crate::delayed_mean::DelayedMean;

/// Longest interval between two of the four poses \[s\]: over longer ones the motion is not a parabola.
const LONGEST_S: f64 = 0.05;
/// Time constant of the mean \[s\].
const MEMORY_S: f64 = 5.0;

/// Measured standard deviations of the noise of poses, along or about each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseDeviations {
    /// \[m\].
    pub position_m: f64,
    /// \[rad\].
    pub attitude_rad: f64,
}

/// Instant of a pose \[s\], its position \[m\] and the angle turned since the first pose \[rad, body\].
type TimedPose = (f64, Vector3<f64>, Vector3<f64>);

/// Measurement of the noise of poses.
#[derive(Clone, Debug)]
pub struct MeasuredNoise {
    /// The last three poses, the newest first.
    last: [Option<TimedPose>; 3],
    attitude: Attitude,
    position: DelayedMean,
    angle: DelayedMean,
    most: PoseDeviations,
}

impl MeasuredNoise {
    /// A measurement that starts with the noise of the cameras in `config`.
    pub fn new(config: &Config) -> Self {
        let (told, safety) = (&config.control.predictive.filter, &config.safety);
        let mean = |deviation: f64| DelayedMean::new(deviation * deviation, MEMORY_S);
        Self {
            last: [None; 3],
            attitude: Attitude::LEVEL,
            position: mean(told.position_noise_mm * 1e-3),
            angle: mean(told.attitude_noise_deg.to_radians()),
            most: PoseDeviations {
                position_m: safety.max_position_noise_mm * 1e-3,
                attitude_rad: safety.max_attitude_noise_deg.to_radians(),
            },
        }
    }

    /// The measured noise.
    pub fn deviations(&self) -> PoseDeviations {
        PoseDeviations {
            position_m: self.position.mean().sqrt().min(self.most.position_m),
            attitude_rad: self.angle.mean().sqrt().min(self.most.attitude_rad),
        }
    }

    /// Takes a pose measured at `t_s` \[s\]; returns whether the measured noise may have changed. While poses are not `credible`, the
    /// values that are not in the mean yet are discarded.
    pub fn take(&mut self, t_s: f64, pose: &MeasuredPose, credible: bool) -> bool {
        let turned = self.attitude.rotation_to(&pose.attitude);
        let angle = self.last[0].map_or(turned, |(_, _, angle)| angle + turned);
        self.attitude = pose.attitude;
        let mut changed = false;
        if let [Some(a), Some(b), Some(c)] = self.last
            && let Some(weights) = parabola(t_s, [a.0, b.0, c.0])
        {
            let gain = 3.0 * (1.0 + weights.norm_squared());
            let residual = |now: &Vector3<f64>, before: [&Vector3<f64>; 3]| {
                let [a, b, c] = before;
                (now - a * weights.x - b * weights.y - c * weights.z).norm_squared() / gain
            };
            changed |= self.position.take(t_s, residual(&pose.position, [&a.1, &b.1, &c.1]));
            changed |= self.angle.take(t_s, residual(&angle, [&a.2, &b.2, &c.2]));
        }
        if !credible {
            self.position.discard();
            self.angle.discard();
        }
        self.last = [Some((t_s, pose.position, angle)), self.last[0], self.last[1]];
        changed
    }
}

/// Weights of the values at `times` \[s\] in the parabola's value at `t_s` \[s\]; `None` if an interval is too long or not positive.
fn parabola(t_s: f64, [a, b, c]: [f64; 3]) -> Option<Vector3<f64>> {
    let is_near = |later: f64, earlier: f64| (1e-4..=LONGEST_S).contains(&(later - earlier));
    let weight = |at: f64, others: [f64; 2]| {
        others.map(|other| (t_s - other) / (at - other)).iter().product::<f64>()
    };
    (is_near(t_s, a) && is_near(a, b) && is_near(b, c))
        .then(|| Vector3::new(weight(a, [b, c]), weight(b, [a, c]), weight(c, [a, b])))
}
