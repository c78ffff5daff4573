//! Detection of crashes from the true motion.

use std::fmt;

use nalgebra::Vector3;
use oqtal_bus::code::Mode;
use oqtal_config::FenceOptions;
use oqtal_control::trajectory::Phase;

use crate::flight_sample::FlightSample;

/// Vertical component of the body's z axis below which the vehicle has turned over \[-\]: the cosine of 80 degrees.
const TURNED_OVER: f64 = 0.17;
/// Speed above which contact with the floor is a crash \[m/s\]: several times the speed of a landing.
const HARD_M_S: f64 = 1.5;
/// Least sink rate of a vehicle that the floor stops \[m/s\]: one that skims over the floor changes its sink rate, too.
const LEAST_FALL_M_S: f64 = 0.1;
/// Height above the floor up to which a vehicle may be in contact with it \[m\].
pub(crate) const AT_FLOOR_M: f64 = 0.05;
/// Height above the floor below which a vehicle in flight is on it, or has just left it again \[m\]: more than it rises within a tick.
const TOUCHED_M: f64 = 0.01;
/// Speed below which a vehicle is at rest \[m/s\].
pub(crate) const AT_REST_M_S: f64 = 0.1;
/// Distance beyond the fence at which the vehicle is lost \[m\].
const LOST_M: f64 = 12.0;

/// Cause of a crash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crash {
    /// The vehicle touched the floor during the flight, or did not take off.
    Floor,
    /// The vehicle hit the floor too fast, possibly while landing.
    Hard {
        /// Speed towards the floor \[m/s\].
        speed: f64,
    },
    /// The vehicle turned over.
    TurnedOver {
        /// Angle between the body's z axis and the vertical \[deg\].
        tilt_deg: f64,
    },
    /// The vehicle flew away.
    Lost {
        /// Position of the vehicle \[m, world\].
        position: [f64; 3],
    },
    /// The daemon ended in flight, or hung; the next one starts disarmed, and the vehicle falls.
    DaemonDied,
}

impl Crash {
    /// Description without figures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Floor => "was on the floor",
            Self::Hard { .. } => "hit the floor",
            Self::TurnedOver { .. } => "turned over",
            Self::Lost { .. } => "flew away",
            Self::DaemonDied => "fell: the daemon ended or hung in flight",
        }
    }

    /// Crash of an armed vehicle in the state of `sample`, after the tick `before`; it was armed at the height `floor_m` \[m, world z\].
    /// `None` if it flies, also beside a table on which it was armed.
    pub fn of(
        (before, sample): (Option<&FlightSample>, &FlightSample),
        fence: &FenceOptions,
        floor_m: f64,
    ) -> Option<Self> {
        let phase = sample.telemetry.phase;
        let is_airborne =
            [Phase::Settle, Phase::Trajectory].map(|phase| phase as u8).contains(&phase)
                && sample.telemetry.mode == Mode::Flying.code();
        let position = sample.position();
        let upright = sample.attitude().to_world(&Vector3::z()).z;
        if upright < TURNED_OVER {
            let tilt_deg = upright.clamp(-1.0, 1.0).acos().to_degrees();
            return Some(Self::TurnedOver { tilt_deg });
        }
        if beyond(fence, &position) > LOST_M {
            return Some(Self::Lost { position: position.into() });
        }
        let rests = |sample: &FlightSample| {
            let height_m = sample.position().z - floor_m;
            (-AT_FLOOR_M..=TOUCHED_M).contains(&height_m) && sample.velocity().norm() < AT_REST_M_S
        };
        let is_down = position.z <= floor_m.min(0.0) + TOUCHED_M
            || rests(sample) && before.is_some_and(rests);
        (is_airborne && is_down).then_some(Self::Floor)
    }

    /// Crash of a vehicle, armed or not, that fell in the previous tick and was stopped by the floor at `floor_m` \[m, world z\]; `None`
    /// otherwise.
    pub fn at_touchdown(
        before: &FlightSample,
        sample: &FlightSample,
        floor_m: f64,
    ) -> Option<Self> {
        let [fall, rest] = [before, sample].map(|sample| -sample.velocity().z);
        let is_stopped = fall > LEAST_FALL_M_S && rest < 0.5 * fall;
        let touches = sample.position().z < floor_m + AT_FLOOR_M && is_stopped;
        let speed = before.velocity().norm();
        (touches && speed > HARD_M_S).then_some(Self::Hard { speed })
    }
}

/// Distance of `position` \[m, world\] beyond the box around the fence \[m\]; 0 inside.
pub(crate) fn beyond(fence: &FenceOptions, position: &Vector3<f64>) -> f64 {
    let distance = |(axis, [from, to]): (usize, [f64; 2])| {
        (from - position[axis]).max(position[axis] - to).max(0.0)
    };
    Vector3::from_iterator(fence.ranges_m().into_iter().enumerate().map(distance)).norm()
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Floor | Self::DaemonDied => f.write_str(self.name()),
            Self::Hard { speed } => write!(f, "hit the floor at {speed:.1} m/s"),
            Self::TurnedOver { tilt_deg } => write!(f, "turned over, tilt {tilt_deg:.0} deg"),
            Self::Lost { position: [x, y, z] } => {
                write!(
                    f,
                    "flew {LOST_M} m beyond [fence], to x = {x:.1} m, y = {y:.1} m, z = {z:.1} m"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{TelemetryV1, TruthV1};
    use oqtal_config::Config;

    fn at(position: [f64; 3], attitude: [f64; 4]) -> FlightSample {
        let (mode, phase) = (Mode::Flying.code(), Phase::Trajectory as u8);
        let telemetry = TelemetryV1 { mode, phase, ..TelemetryV1::default() };
        let truth = TruthV1 { position, attitude, ..TruthV1::default() };
        FlightSample { telemetry, truth: Some(truth) }
    }

    #[test]
    fn a_crash_has_a_cause_and_a_place() {
        let level = [0.0, 0.0, 0.0, 1.0];
        let config = Config::default();
        let said =
            |sample| Crash::of((None, &sample), &config.fence, 0.0).map(|crash| crash.to_string());
        assert_eq!(said(at([1.0, 1.0, 1.0], level)), None);
        assert_eq!(said(at([0.0, 0.0, 0.005], level)).unwrap(), "was on the floor");
        assert_eq!(said(at([0.0, 0.0, 0.02], level)), None);
        let text = said(at([20.1, 0.0, 1.0], level)).unwrap();
        assert!(text.contains("12 m beyond [fence], to x = 20.1 m"), "{text}");
        assert_eq!(said(at([19.9, 0.0, 1.0], level)), None);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let over = [half, 0.0, 0.0, half];
        assert_eq!(said(at([0.0, 0.0, 1.0], over)).unwrap(), "turned over, tilt 90 deg");
    }

    #[test]
    fn a_touchdown_is_a_crash_by_its_speed_and_a_fall_before_the_floor_is_not() {
        let with = |height: f64, velocity: [f64; 3]| {
            let sample = at([0.0, 0.0, height], [0.0, 0.0, 0.0, 1.0]);
            let truth = sample.truth.map(|truth| TruthV1 { velocity, ..truth });
            FlightSample { truth, ..sample }
        };
        let moving = |height: f64, climb: f64| with(height, [0.0, 0.0, climb]);
        let said = |before, after| Crash::at_touchdown(&before, &after, 0.0).map(|c| c.to_string());
        let sideways = said(with(0.01, [3.0, 0.0, -0.6]), with(0.0, [2.9, 0.0, 0.0]));
        assert_eq!(sideways.unwrap(), "hit the floor at 3.1 m/s");
        let skims = said(with(0.03, [3.0, 0.0, 0.01]), with(0.03, [3.0, 0.0, 0.01]));
        assert_eq!(skims, None, "a low path");
        let hard = said(moving(0.03, -2.54), moving(0.0, 0.0));
        assert_eq!(hard.unwrap(), "hit the floor at 2.5 m/s");
        assert_eq!(said(moving(0.01, -0.6), moving(0.0, 0.0)), None, "a landing");
        assert_eq!(said(moving(0.08, -2.5), moving(0.04, -2.6)), None, "still falling");
        assert_eq!(said(moving(1.0, -2.5), moving(1.0, 0.0)), None, "in the air");
    }

    #[test]
    fn a_polygon_replaces_the_ranges_of_x_and_y() {
        let polygon_m = vec![[0.0, 0.0], [40.0, 0.0], [40.0, 40.0]];
        let fence = FenceOptions { polygon_m, ..Config::default().fence };
        assert!(beyond(&fence, &Vector3::new(50.0, 20.0, 1.0)) == 10.0);
        assert!(beyond(&fence, &Vector3::new(30.0, 20.0, 1.0)) == 0.0);
    }
}
