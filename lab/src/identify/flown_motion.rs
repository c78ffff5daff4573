//! Motion of flights: whether they excite what determines a parameter.

use nalgebra::Vector3;

use super::data::{FlightData, PoseRecord};
use super::finding::{ParameterFinding, rules};

/// Time over which rates and velocities are means, so that camera noise does not count \[s\].
const WINDOW_S: f64 = 0.2;
/// Three quarters of the root mean square of the trajectory `excitation` about roll, pitch and yaw \[rad/s, body\].
const RATES: [f64; 3] = [0.22, 0.25, 0.15];
/// Three quarters of that along the horizon \[m/s, world\].
const SPEED: f64 = 0.27;
/// Three quarters of the root mean square of the horizontal part of body z, along x and y \[-, world\]: tilts separate the thrust from
/// constant forces.
const TILTS: [f64; 2] = [0.05, 0.045];
/// Climbs and descents that are some steps; hovers drift by less \[m, world\].
const CLIMBS_M: f64 = 1.0;

/// Motion of the flight that moves most, as root mean squares except for the climbs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlownMotion {
    /// About roll, pitch and yaw \[rad/s, body\].
    rates: [f64; 3],
    /// Along the horizon \[m/s, world\].
    speed: f64,
    /// Horizontal part of body z along x and y \[-, world\].
    tilts: [f64; 2],
    /// Length of the path along the vertical, without take-off and landing \[m, world\].
    climbs_m: f64,
}

impl FlownMotion {
    /// The motion of `flights`.
    pub fn of(flights: &[FlightData]) -> Self {
        flights.iter().map(|data| Self::of_poses(&data.air)).fold(Self::default(), Self::greater)
    }

    fn of_poses(poses: &[PoseRecord]) -> Self {
        let (mut rates, mut tilts) = (Vector3::zeros(), Vector3::zeros());
        let (mut speed, mut last, mut count) = (0.0, 0, 0_u32);
        for first in poses {
            while poses.get(last).is_some_and(|it| it.captured_s < first.captured_s + WINDOW_S) {
                last += 1;
            }
            let Some(pose) = poses.get(last) else { break };
            let h_s = pose.captured_s - first.captured_s;
            let turned = first.attitude.rotation_to(&pose.attitude);
            rates += (turned / h_s).map(|rate| rate * rate);
            speed += ((pose.position - first.position).xy() / h_s).norm_squared();
            tilts += (first.attitude.unit_quaternion() * Vector3::z()).map(|part| part * part);
            count += 1;
        }
        let mean = |square: f64| (square / f64::from(count.max(1))).sqrt();
        let [tilt_x, tilt_y, _] = tilts.map(mean).into();
        Self {
            rates: rates.map(mean).into(),
            speed: mean(speed),
            tilts: [tilt_x, tilt_y],
            climbs_m: climbs_m(poses),
        }
    }

    fn greater(self, other: Self) -> Self {
        Self {
            rates: std::array::from_fn(|axis| self.rates[axis].max(other.rates[axis])),
            speed: self.speed.max(other.speed),
            tilts: std::array::from_fn(|axis| self.tilts[axis].max(other.tilts[axis])),
            climbs_m: self.climbs_m.max(other.climbs_m),
        }
    }

    /// Assumption of the model that may not hold, if the flights excite what determines `finding`; `None` if they do not.
    pub fn assumption(&self, finding: &ParameterFinding) -> Option<&'static str> {
        let turns = |axis: usize| self.rates[axis] >= RATES[axis];
        let name = finding.name;
        let about = rules::AUTHORITY.iter().position(|rule| rule.name == name);
        match (about, name) {
            (Some(axis), _) => turns(axis).then_some(ONE_LAG),
            _ if [rules::DELAY.name, rules::RATE_LAG.name].contains(&name) => {
                (turns(0) && turns(1)).then_some(ONE_LAG)
            }
            _ if name == rules::DRAG.name => (self.speed >= SPEED).then_some(LINEAR_DRAG),
            _ if name == rules::THRUST_LAG.name => {
                (self.climbs_m >= CLIMBS_M).then_some(ONE_THRUST)
            }
            _ if [rules::THRUST.name, rules::MASS.name].contains(&name) => {
                (self.tilts[0] >= TILTS[0] && self.tilts[1] >= TILTS[1]).then_some(ONE_THRUST)
            }
            _ => None,
        }
    }
}

/// Length of the path along the vertical, without those from the first pose to the mean height and from there to the last \[m\].
fn climbs_m(poses: &[PoseRecord]) -> f64 {
    let [Some(first), Some(end)] = [poses.first(), poses.last()] else { return 0.0 };
    let mean_m = poses.iter().map(|pose| pose.position.z).sum::<f64>() / poses.len() as f64;
    let to_mean_m = |pose: &PoseRecord| (pose.position.z - mean_m).abs();
    let (mut last, mut path_m) = (first, 0.0);
    for pose in poses {
        if pose.captured_s >= last.captured_s + WINDOW_S {
            path_m += (pose.position.z - last.position.z).abs();
            last = pose;
        }
    }
    path_m - to_mean_m(first) - to_mean_m(end)
}

/// Assumption of the rotation.
const ONE_LAG: &str = "one lag for all axes, and one delay";
/// Assumption of the translation.
const LINEAR_DRAG: &str = "linear drag, and thrust with one lag that depends on its command alone";
/// Assumption of the thrust. The interval of the delay is propagated to it.
const ONE_THRUST: &str = "thrust with one lag that depends on its command alone, and a known delay (its interval is part of this one)";

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use oqtal_control::quaternion::Attitude;

    use super::*;
    use crate::identify::finding::FindingRule;

    /// Motion of ten seconds that oscillate by `climb_m` and by `tilt_rad` about both axes.
    fn flown(climb_m: f64, tilt_rad: f64) -> FlownMotion {
        let pose = |k: u32| {
            let captured_s = f64::from(k) / 60.0;
            let (sin, cos) = (3.0 * captured_s).sin_cos();
            let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(sin, cos, 0.0) * tilt_rad);
            PoseRecord {
                captured_s,
                latency_s: 0.0,
                position: Vector3::z() * (1.0 + climb_m * sin),
                attitude: Attitude::from_unit_quaternion(attitude),
            }
        };
        FlownMotion::of_poses(&(0..600).map(pose).collect::<Vec<_>>())
    }

    #[test]
    fn a_manoeuvre_is_named_only_if_the_flight_lacks_it() {
        let reason = |motion: FlownMotion, rule: &FindingRule| {
            let wide = rule.found(20.0, f64::INFINITY, None);
            let assumption = motion.assumption(&wide);
            wide.with_assumption(assumption).missing
        };
        let all = [&rules::THRUST, &rules::MASS, &rules::THRUST_LAG];
        let [hover, climbing, tilting] = [(0.005, 0.01), (0.3, 0.01), (0.005, 0.15)]
            .map(|(climb_m, tilt_rad)| all.map(|rule| reason(flown(climb_m, tilt_rad), rule)));
        assert_eq!(hover, all.map(|rule| Some(rule.motion)));
        assert_eq!(climbing, [hover[0], hover[1], None]);
        assert_eq!(tilting, [None, None, hover[2]]);
    }
}
