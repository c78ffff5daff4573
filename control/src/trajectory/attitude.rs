//! Prescribed attitudes, about roll and then about pitch: tests of the attitude loop without the position loops. Not
//! in the paper.
//!
//! Meanwhile only the height is controlled. After each axis the vehicle flies back to the hover point.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::reference::{Phase, Reference};
use crate::options::{OptionError, Rule, check_options};
use crate::quantity::{AngularAcceleration, BodyRate};
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeReference;

/// The greatest angle that may be prescribed \[deg\].
const GREATEST_DEG: f64 = 30.0;

/// A sine of rising frequency: shows up to which frequency an attitude loop follows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct AttitudeChirp {
    /// Amplitude \[deg\].
    pub amplitude_deg: f64,
    /// Frequency at the start \[Hz\].
    pub from_hz: f64,
    /// Frequency at the end \[Hz\].
    pub to_hz: f64,
    /// Time of a sweep about one axis \[s\].
    pub sweep_s: f64,
    /// Time for the flight back after each axis \[s\].
    pub recovery_s: f64,
}

impl Default for AttitudeChirp {
    fn default() -> Self {
        Self { amplitude_deg: 4.0, from_hz: 0.5, to_hz: 3.0, sweep_s: 8.0, recovery_s: 6.0 }
    }
}

impl AttitudeChirp {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("amplitude-deg", self.amplitude_deg, Rule::Between(-GREATEST_DEG, GREATEST_DEG)),
            ("from-hz", self.from_hz, Rule::Between(0.01, 30.0)),
            ("to-hz", self.to_hz, Rule::Between(0.01, 30.0)),
            ("sweep-s", self.sweep_s, Rule::Between(0.1, 60.0)),
            ("recovery-s", self.recovery_s, Rule::Between(0.0, 60.0)),
        ])
    }

    pub(super) fn duration_s(&self) -> f64 {
        2.0 * (self.sweep_s + self.recovery_s)
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        turn(t_s, self.sweep_s, self.recovery_s, |t_s| {
            let growth = (self.to_hz - self.from_hz) / self.sweep_s;
            let phase = TAU * (self.from_hz + growth * t_s / 2.0) * t_s;
            let (frequency, growth) = (TAU * (self.from_hz + growth * t_s), TAU * growth);
            let (sin, cos) = phase.sin_cos();
            [sin, frequency * cos, growth * cos - frequency * frequency * sin]
                .map(|share| share * self.amplitude_deg.to_radians())
        })
    }
}

/// A step to one side, one to the other side, and one back to level: shows how fast an attitude loop settles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct AttitudeDoublet {
    /// Size of the steps \[deg\].
    pub angle_deg: f64,
    /// Time at either side, and at level \[s\].
    pub hold_s: f64,
    /// Time for the flight back after each axis \[s\].
    pub recovery_s: f64,
}

impl Default for AttitudeDoublet {
    fn default() -> Self {
        Self { angle_deg: 10.0, hold_s: 1.0, recovery_s: 6.0 }
    }
}

impl AttitudeDoublet {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("angle-deg", self.angle_deg, Rule::Between(-GREATEST_DEG, GREATEST_DEG)),
            ("hold-s", self.hold_s, Rule::Between(0.1, 60.0)),
            ("recovery-s", self.recovery_s, Rule::Between(0.0, 60.0)),
        ])
    }

    pub(super) fn duration_s(&self) -> f64 {
        2.0 * (3.0 * self.hold_s + self.recovery_s)
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        turn(t_s, 3.0 * self.hold_s, self.recovery_s, |t_s| {
            // The cast rounds down.
            let side = [1.0, -1.0, 0.0][((t_s / self.hold_s) as usize).min(2)];
            [side * self.angle_deg.to_radians(), 0.0, 0.0]
        })
    }
}

/// At `t_s`: about roll and then about pitch for `turning_s` the angle, rate and acceleration that
/// `course` gives at the time since the start of the turn, and at rest for `recovery_s` after each.
fn turn(t_s: f64, turning_s: f64, recovery_s: f64, course: impl Fn(f64) -> [f64; 3]) -> Reference {
    let second = turning_s + recovery_s;
    let (axis, since_s) =
        if t_s < second { (Vector3::x(), t_s) } else { (Vector3::y(), t_s - second) };
    let mut reference = Reference::rest(Vector3::zeros(), Phase::Trajectory);
    if since_s < turning_s {
        let [angle, rate, acceleration] = course(since_s);
        reference.attitude = Some(AttitudeReference {
            attitude: Attitude::from_rotation_vector(axis * angle),
            rate: BodyRate(axis * rate),
            acceleration: AngularAcceleration(axis * acceleration),
        });
    }
    reference
}
