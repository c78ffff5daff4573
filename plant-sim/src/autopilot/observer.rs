//! Motion of a vehicle between the samples that its simulator reports. Pure.
//!
//! A simulator reports position in steps of a centimetre (one unit of the seventh decimal of a degree), and velocity at a much
//! finer resolution. The observer integrates the velocity and keeps the position within half a step of the reported one.

use nalgebra::{UnitQuaternion, Vector3};
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_control::quaternion::Attitude;
use oqtal_wire::mavlink::MavlinkTruth;

/// Time without a sample after which the motion is unknown: the simulator has stopped.
const SAMPLE_TIMEOUT: Span = Span::from_millis(250);
/// Longest prediction from a sample.
const LONGEST_PREDICTION: Span = Span::from_millis(50);
/// Difference between reported and integrated position above which the simulator has moved the vehicle to another place \[m\].
const JUMP_M: f64 = 0.5;
/// Equatorial radius of the earth, with which simulators map positions to a plane \[m\].
const EARTH_M: f64 = 6_378_137.0;
/// One count of latitude and longitude \[rad\].
const COUNT: f64 = 1e-7 * std::f64::consts::PI / 180.0;

/// Motion in world axes.
#[derive(Clone, Copy, Debug)]
struct ObservedMotion {
    at: Time,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    rate: Vector3<f64>,
}

/// Position and heading of the vehicle in its first sample: origin and x axis of the world.
#[derive(Clone, Copy, Debug)]
struct MotionStart {
    latitude_e7: i32,
    longitude_e7: i32,
    altitude_m: f64,
    heading: UnitQuaternion<f64>,
}

impl MotionStart {
    fn new(sample: &MavlinkTruth) -> Self {
        let yaw = attitude_of(sample).euler_angles().2;
        Self {
            latitude_e7: sample.latitude_e7,
            longitude_e7: sample.longitude_e7,
            altitude_m: sample.altitude_m,
            heading: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw),
        }
    }

    /// Position \[m, world\] on the plane tangent to the earth at the origin.
    fn position(&self, sample: &MavlinkTruth) -> Vector3<f64> {
        let north = f64::from(sample.latitude_e7) - f64::from(self.latitude_e7);
        let east = f64::from(sample.longitude_e7) - f64::from(self.longitude_e7);
        let narrowing = (f64::from(self.latitude_e7) * COUNT).cos();
        let up = sample.altitude_m - self.altitude_m;
        let position =
            Vector3::new(north * COUNT * EARTH_M, -east * COUNT * EARTH_M * narrowing, up);
        self.heading.inverse() * position
    }
}

/// Observer of a vehicle's motion. The origin of the world is the vehicle's first position, and x is its first heading.
#[derive(Clone, Debug, Default)]
pub struct SimulatorObserver {
    start: Option<MotionStart>,
    motion: Option<ObservedMotion>,
}

impl SimulatorObserver {
    /// Takes a sample that arrived at `now`.
    pub fn take(&mut self, now: Time, sample: &MavlinkTruth) {
        let start = *self.start.get_or_insert_with(|| MotionStart::new(sample));
        let reported = start.position(sample);
        // Half a step of latitude, for any heading of the world; a step of longitude is shorter.
        let step = COUNT * EARTH_M;
        let half = Vector3::new(step, step, sample.altitude_step_m) * 0.5;
        let position = match self.predicted(now) {
            Some(at) if (at.position - reported).norm() < JUMP_M => {
                at.position.sup(&(reported - half)).inf(&(reported + half))
            }
            _ => reported,
        };
        let world = start.heading.inverse();
        self.motion = Some(ObservedMotion {
            at: now,
            position,
            velocity: world * Vector3::from(sample.velocity),
            attitude: world * attitude_of(sample),
            rate: sample.rate.into(),
        });
    }

    /// The motion at `now`; `None` if it is unknown.
    pub fn truth(&self, now: Time) -> Option<TruthV1> {
        let motion = self.predicted(now)?;
        let q = motion.attitude.quaternion();
        Some(TruthV1 {
            time: now,
            capture: 0,
            position: motion.position.into(),
            velocity: motion.velocity.into(),
            attitude: [q.i, q.j, q.k, q.w],
            rate: motion.rate.into(),
        })
    }

    /// The motion at `now`, predicted from the last sample with its velocity and rate.
    fn predicted(&self, now: Time) -> Option<ObservedMotion> {
        let last = self.motion.filter(|last| now.since(last.at) <= SAMPLE_TIMEOUT)?;
        let ahead = now.since(last.at).clamp(Span::ZERO, LONGEST_PREDICTION).seconds();
        Some(ObservedMotion {
            at: now,
            position: last.position + last.velocity * ahead,
            attitude: last.attitude * UnitQuaternion::from_scaled_axis(last.rate * ahead),
            ..last
        })
    }
}

fn attitude_of(sample: &MavlinkTruth) -> UnitQuaternion<f64> {
    *Attitude::from_xyzw(sample.attitude).unwrap_or_default().unit_quaternion()
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Time = Time::VIRTUAL_START;
    /// One count of latitude \[m\].
    const STEP_M: f64 = COUNT * EARTH_M;

    /// A vehicle on the equator that points north-west: x is north, y west.
    fn sample() -> MavlinkTruth {
        let (sin, cos) = std::f64::consts::FRAC_PI_8.sin_cos();
        MavlinkTruth {
            time_us: None,
            latitude_e7: 0,
            longitude_e7: 1_491_652_300,
            altitude_m: 584.0,
            altitude_step_m: 0.01,
            velocity: [0.0; 3],
            attitude: [0.0, 0.0, sin, cos],
            rate: [0.0; 3],
        }
    }

    /// The same vehicle at another place \[counts\], with another velocity.
    fn at(north: i32, east: i32, velocity: [f64; 3]) -> MavlinkTruth {
        let first = sample();
        MavlinkTruth {
            latitude_e7: first.latitude_e7 + north,
            longitude_e7: first.longitude_e7 + east,
            velocity,
            ..first
        }
    }

    fn near(left: [f64; 3], right: [f64; 3]) -> bool {
        left.into_iter().zip(right).all(|(left, right)| (left - right).abs() < 1e-9)
    }

    #[test]
    fn the_first_sample_is_the_origin_and_x_points_forward() {
        let mut observer = SimulatorObserver::default();
        assert!(observer.truth(START).is_none());
        observer.take(START, &sample());
        let truth = observer.truth(START).unwrap();
        assert!(near(truth.position, [0.0; 3]), "{truth:?}");
        assert!((truth.attitude[3].abs() - 1.0).abs() < 1e-12, "{truth:?}");
        // A jump to the north-west is one forward; climbing is upward.
        let moved = MavlinkTruth { altitude_m: 586.0, ..at(1000, -1000, [1.0, 1.0, 3.0]) };
        observer.take(START, &moved);
        let truth = observer.truth(START).unwrap();
        assert!(near(truth.position, [1000.0 * STEP_M * 2f64.sqrt(), 0.0, 2.0]), "{truth:?}");
        assert!(near(truth.velocity, [2f64.sqrt(), 0.0, 3.0]), "{truth:?}");
    }

    #[test]
    fn a_turn_is_reported_in_the_axes_of_the_start_and_continues_between_samples() {
        let mut observer = SimulatorObserver::default();
        observer.take(START, &sample());
        observer.take(START, &MavlinkTruth { rate: [0.0, 0.0, 2.0], ..sample() });
        let truth = observer.truth(START + Span::from_millis(50)).unwrap();
        assert!((truth.attitude[2] - f64::sin(0.05)).abs() < 1e-12, "{truth:?}");
    }

    /// Climb at 1 m/s, sampled at 60 Hz in steps of a centimetre: the observed height has no steps.
    #[test]
    fn steps_of_the_altitude_are_smoothed_by_the_velocity() {
        let mut observer = SimulatorObserver::default();
        let mut heights = Vec::new();
        for number in 0..120 {
            let climbed = f64::from(number) / 60.0;
            // Without the addition, 1.15 s would be 114 steps.
            let altitude_m = 584.0 + (climbed * 100.0 + 1e-6).floor() / 100.0;
            let now = START + Span::from_seconds(climbed);
            let velocity = [0.0, 0.0, 1.0];
            observer.take(now, &MavlinkTruth { altitude_m, velocity, ..sample() });
            heights.push(observer.truth(now).unwrap().position[2]);
        }
        for pair in heights[10..].windows(2) {
            assert!((pair[1] - pair[0] - 1.0 / 60.0).abs() < 1e-3, "{pair:?}");
        }
    }

    /// Forward flight at 1 m/s, sampled at 100 Hz in steps of a centimetre.
    #[test]
    fn steps_of_the_position_are_smoothed_by_the_velocity() {
        let mut observer = SimulatorObserver::default();
        let mut worst: f64 = 0.0;
        for number in 0..300 {
            let now = START + Span::from_millis(10 * number);
            let travelled = 0.01 * number as f64;
            let counts = (travelled / STEP_M / 2f64.sqrt()).floor() as i32;
            let forward = std::f64::consts::FRAC_1_SQRT_2;
            observer.take(now, &at(counts, -counts, [forward, forward, 0.0]));
            let truth = observer.truth(now + Span::from_millis(5)).unwrap();
            if number > 5 {
                worst = worst.max((truth.position[0] - travelled - 0.005).abs());
            }
        }
        assert!(worst < STEP_M, "{worst}");
    }

    #[test]
    fn a_simulator_that_stops_has_no_motion_and_one_that_restarts_jumps() {
        let mut observer = SimulatorObserver::default();
        observer.take(START, &at(0, 0, [1.0, 0.0, 0.0]));
        assert!(observer.truth(START + Span::from_millis(250)).is_some());
        assert!(observer.truth(START + Span::from_millis(251)).is_none());
        observer.take(START + Span::from_millis(10), &at(1000, -1000, [0.0; 3]));
        let truth = observer.truth(START + Span::from_millis(10)).unwrap();
        assert!((truth.position[0] - 1000.0 * STEP_M * 2f64.sqrt()).abs() < 1e-9);
    }
}
