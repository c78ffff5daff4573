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

/// Root mean squares of the motion of the flight that moves most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlownMotion {
    /// About roll, pitch and yaw \[rad/s, body\].
    rates: [f64; 3],
    /// Along the horizon \[m/s, world\].
    speed: f64,
}

impl FlownMotion {
    /// The motion of `flights`.
    pub fn of(flights: &[FlightData]) -> Self {
        flights.iter().map(|data| Self::of_poses(&data.air)).fold(Self::default(), Self::greater)
    }

    fn of_poses(poses: &[PoseRecord]) -> Self {
        let (mut rates, mut speed) = (Vector3::zeros(), 0.0);
        let (mut last, mut count) = (0, 0_u32);
        for first in poses {
            while poses.get(last).is_some_and(|it| it.captured_s < first.captured_s + WINDOW_S) {
                last += 1;
            }
            let Some(pose) = poses.get(last) else { break };
            let h_s = pose.captured_s - first.captured_s;
            let turned =
                first.attitude.unit_quaternion().inverse() * pose.attitude.unit_quaternion();
            rates += (turned.scaled_axis() / h_s).map(|rate| rate * rate);
            speed += ((pose.position - first.position).xy() / h_s).norm_squared();
            count += 1;
        }
        let mean = |square: f64| (square / f64::from(count.max(1))).sqrt();
        Self { rates: rates.map(mean).into(), speed: mean(speed) }
    }

    fn greater(self, other: Self) -> Self {
        let rates = std::array::from_fn(|axis| self.rates[axis].max(other.rates[axis]));
        Self { rates, speed: self.speed.max(other.speed) }
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
            _ => None,
        }
    }
}

/// Assumption of the rotation.
const ONE_LAG: &str = "one lag for all axes, and one delay";
/// Assumption of the translation.
const LINEAR_DRAG: &str = "linear drag, and thrust with one lag that depends on its command alone";
