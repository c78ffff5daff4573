//! The shapes of trajectories with their parameters in the configuration.
//!
//! Positions are relative to the hover point, times to the start of the trajectory.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::reference::{Phase, Reference};
use crate::options::{OptionError, Rule, check_options};
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeReference;

/// Longest trajectory \[s\]: a week, for soak tests.
pub(super) const MAX_DURATION_S: f64 = 7.0 * 24.0 * 3600.0;

/// Rest at the hover point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Hover {
    /// Duration \[s\].
    pub duration_s: f64,
}

impl Default for Hover {
    fn default() -> Self {
        Self { duration_s: 30.0 }
    }
}

impl Hover {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([("duration-s", self.duration_s, Rule::Between(0.0, MAX_DURATION_S))])
    }
}

/// The Euler angle of a [`Step`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepAxis {
    /// About body x; positive moves the vehicle to its right.
    Roll,
    /// About body y; positive moves the vehicle forward.
    Pitch,
    /// About body z; positive is anticlockwise from above.
    Yaw,
}

/// A step of one Euler angle: up at the start, back to zero after `hold-s`; the remaining time is for the flight
/// back.
///
/// Roll and pitch are prescribed as an attitude, so the horizontal position is not controlled during the step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Step {
    /// The angle that is stepped.
    pub axis: StepAxis,
    /// Size of the step \[deg\].
    pub angle_deg: f64,
    /// Time for which the angle is held \[s\].
    pub hold_s: f64,
    /// Duration of the trajectory \[s\].
    pub duration_s: f64,
}

impl Default for Step {
    fn default() -> Self {
        Self { axis: StepAxis::Roll, angle_deg: 10.0, hold_s: 1.0, duration_s: 6.0 }
    }
}

impl Step {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        let greatest = if self.axis == StepAxis::Yaw { 180.0 } else { 30.0 };
        check_options([
            ("angle-deg", self.angle_deg, Rule::Between(-greatest, greatest)),
            ("duration-s", self.duration_s, Rule::Between(0.0, 3600.0)),
            ("hold-s", self.hold_s, Rule::Between(0.0, self.duration_s)),
        ])
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let mut reference = Reference::rest(Vector3::zeros(), Phase::Trajectory);
        if t_s < self.hold_s {
            let angle = self.angle_deg.to_radians();
            let turned = |axis: Vector3<f64>| {
                Some(AttitudeReference::at_rest(Attitude::from_rotation_vector(axis * angle)))
            };
            match self.axis {
                StepAxis::Roll => reference.attitude = turned(Vector3::x()),
                StepAxis::Pitch => reference.attitude = turned(Vector3::y()),
                StepAxis::Yaw => reference.yaw_rad = angle,
            }
        }
        reference
    }
}

/// The square of Fig. 17, anticlockwise from above and back to its start: the reference jumps from corner to corner.
///
/// The paper prints no size; 1.3 m and 5 s agree with its figures and Table V.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Square {
    /// Side \[m\].
    pub side_m: f64,
    /// Time between jumps; the first is at the start \[s\].
    pub dwell_s: f64,
    /// Duration of the trajectory \[s\].
    pub duration_s: f64,
}

impl Default for Square {
    fn default() -> Self {
        Self { side_m: 1.3, dwell_s: 5.0, duration_s: 22.0 }
    }
}

impl Square {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("side-m", self.side_m, Rule::Between(0.0, 100.0)),
            ("dwell-s", self.dwell_s, Rule::Between(0.1, 3600.0)),
            ("duration-s", self.duration_s, Rule::Between(0.0, 3600.0)),
        ])
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        const CORNERS: [[f64; 2]; 4] = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
        // The cast rounds down.
        let [x, y] = CORNERS[((t_s / self.dwell_s) as usize).min(CORNERS.len() - 1)];
        Reference::rest(Vector3::new(x, y, 0.0) * self.side_m, Phase::Trajectory)
    }
}

/// A horizontal circle through the hover point, anticlockwise from above, its centre on the side of negative x.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Circle {
    /// Radius \[m\].
    pub radius_m: f64,
    /// Time of one round at full speed \[s\].
    pub period_s: f64,
    /// Number of rounds \[-\].
    pub laps: u32,
    /// Time from rest to full speed, and back \[s\].
    pub ramp_s: f64,
}

impl Default for Circle {
    fn default() -> Self {
        Self { radius_m: 0.65, period_s: 8.0, laps: 3, ramp_s: 2.0 }
    }
}

impl Circle {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("radius-m", self.radius_m, Rule::Between(0.0, 100.0)),
            ("period-s", self.period_s, Rule::Between(0.1, 3600.0)),
            ("laps", f64::from(self.laps), Rule::Between(1.0, 1000.0)),
            ("ramp-s", self.ramp_s, Rule::Between(0.0, self.period_s)),
        ])
    }

    pub(super) fn sweep(&self) -> Sweep {
        Sweep { period_s: self.period_s, laps: self.laps, ramp_s: self.ramp_s }
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let sweep = self.sweep().sample(t_s);
        let (sin, cos) = sweep[0].sin_cos();
        let curve = [[cos - 1.0, sin], [-sin, cos], [-cos, -sin], [sin, -cos], [cos, sin]];
        along(curve.map(|[x, y]| Vector3::new(x, y, 0.0) * self.radius_m), sweep)
    }
}

/// The plane of a [`Lemniscate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CurvePlane {
    /// Plane of x and y.
    Horizontal,
    /// Plane of x and z.
    Upright,
}

impl CurvePlane {
    /// The direction across x.
    fn across(self) -> Vector3<f64> {
        match self {
            Self::Horizontal => Vector3::y(),
            Self::Upright => Vector3::z(),
        }
    }
}

/// The lemniscate of Gerono, a figure of eight along x, twice as long as wide, crossing at the hover point: x = a sin s,
/// y = a sin s cos s, or z in place of y.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Lemniscate {
    /// Half its length, a \[m\].
    pub half_length_m: f64,
    /// The plane of the figure.
    pub plane: CurvePlane,
    /// Time of one round at full speed \[s\].
    pub period_s: f64,
    /// Number of rounds \[-\].
    pub laps: u32,
    /// Time from rest to full speed, and back \[s\].
    pub ramp_s: f64,
}

impl Default for Lemniscate {
    fn default() -> Self {
        Self {
            half_length_m: 0.65,
            plane: CurvePlane::Horizontal,
            period_s: 8.0,
            laps: 3,
            ramp_s: 2.0,
        }
    }
}

impl Lemniscate {
    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("half-length-m", self.half_length_m, Rule::Between(0.0, 100.0)),
            ("period-s", self.period_s, Rule::Between(0.1, 3600.0)),
            ("laps", f64::from(self.laps), Rule::Between(1.0, 1000.0)),
            ("ramp-s", self.ramp_s, Rule::Between(0.0, self.period_s)),
        ])
    }

    pub(super) fn sweep(&self) -> Sweep {
        Sweep { period_s: self.period_s, laps: self.laps, ramp_s: self.ramp_s }
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let sweep = self.sweep().sample(t_s);
        let (sin, cos) = sweep[0].sin_cos();
        let (double_sin, double_cos) = (sin * cos, cos * cos - sin * sin);
        let curve = [
            [sin, double_sin],
            [cos, double_cos],
            [-sin, -4.0 * double_sin],
            [-cos, -4.0 * double_cos],
            [sin, 16.0 * double_sin],
        ];
        let across = self.plane.across();
        along(curve.map(|[x, y]| (Vector3::x() * x + across * y) * self.half_length_m), sweep)
    }
}

/// The reference on a curve with these derivatives by an angle with those derivatives by time \[m, rad, s\]: Faa di Bruno's formula.
fn along(curve: [Vector3<f64>; 5], sweep: [f64; 5]) -> Reference {
    let ([p, c1, c2, c3, c4], [_, s1, s2, s3, s4]) = (curve, sweep);
    let acceleration = c2 * (s1 * s1) + c1 * s2;
    let jerk = c3 * (s1 * s1 * s1) + c2 * (3.0 * s1 * s2) + c1 * s3;
    let snap = c4 * s1.powi(4)
        + c3 * (6.0 * s1 * s1 * s2)
        + c2 * (3.0 * s2 * s2 + 4.0 * s1 * s3)
        + c1 * s4;
    Reference::moving([p, c1 * s1, acceleration, jerk, snap], Phase::Trajectory)
}

/// Angle as a function of time on a closed curve that starts and ends at rest. The angular speed rises and falls by 3
/// x^2 - 2 x^3, so the acceleration is continuous too.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sweep {
    period_s: f64,
    laps: u32,
    ramp_s: f64,
}

impl Sweep {
    /// A ramp covers half the angle of its time at full speed, hence one ramp more than the laps at full speed.
    pub(super) fn duration_s(&self) -> f64 {
        self.period_s * f64::from(self.laps) + self.ramp_s
    }

    /// Angle at `t_s` in 0..duration, with its first four derivatives \[rad, s\].
    fn sample(&self, t_s: f64) -> [f64; 5] {
        let remaining_s = self.duration_s() - t_s;
        if t_s <= remaining_s {
            return self.rise(t_s);
        }
        let [angle, speed, second, third, fourth] = self.rise(remaining_s);
        [TAU * f64::from(self.laps) - angle, speed, -second, third, -fourth]
    }

    /// The first half of the course.
    fn rise(&self, t_s: f64) -> [f64; 5] {
        let full_speed = TAU / self.period_s;
        if t_s >= self.ramp_s {
            return [full_speed * (t_s - 0.5 * self.ramp_s), full_speed, 0.0, 0.0, 0.0];
        }
        let x = t_s / self.ramp_s;
        let scale = full_speed / self.ramp_s;
        [
            full_speed * self.ramp_s * x * x * x * (1.0 - 0.5 * x),
            full_speed * x * x * (3.0 - 2.0 * x),
            scale * 6.0 * x * (1.0 - x),
            scale / self.ramp_s * (6.0 - 12.0 * x),
            scale / (self.ramp_s * self.ramp_s) * -12.0,
        ]
    }
}
