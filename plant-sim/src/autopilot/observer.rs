//! Motion of a vehicle between the samples that its simulator reports. Pure.
//!
//! A simulator reports position in steps of a centimetre, a unit of the seventh decimal of a degree, and velocity much finer. The
//! observer integrates the velocity and keeps the position within half a step of what is reported.

use nalgebra::{UnitQuaternion, Vector3};
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::simulator::ReportedMotion;

/// Time without a sample after which the motion is unknown: the simulator has stopped.
const SAMPLE_TIMEOUT: Span = Span::from_millis(250);
/// Longest time over which the motion is predicted from a sample.
const LONGEST_PREDICTION: Span = Span::from_millis(50);
/// Distance by which the reported position differs from the integrated one where the simulator has placed the vehicle anew \[m\].
const JUMP_M: f64 = 0.5;

/// Motion in the axes of the world.
#[derive(Clone, Copy, Debug)]
struct Motion {
    at: Time,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    rate: Vector3<f64>,
}

/// Place and heading of the vehicle in its first sample: the origin of the world, and its x axis.
#[derive(Clone, Copy, Debug)]
struct Start {
    position: Vector3<f64>,
    heading: UnitQuaternion<f64>,
}

/// Observer of a vehicle's motion. The world's origin is where the vehicle first is, and x points where it then points.
#[derive(Clone, Debug, Default)]
pub struct MotionObserver {
    start: Option<Start>,
    motion: Option<Motion>,
}

impl MotionObserver {
    /// Takes a report that arrived at `now`.
    pub fn take(&mut self, now: Time, report: &ReportedMotion) {
        let start = *self.start.get_or_insert_with(|| Start {
            position: report.position,
            heading: UnitQuaternion::from_axis_angle(
                &Vector3::z_axis(),
                report.attitude.euler_angles().2,
            ),
        });
        // Half a turn about the x axis maps north-east-down, turned to the heading, to the world, and the body's axes likewise.
        let flip = |vector: Vector3<f64>| Vector3::new(vector.x, -vector.y, -vector.z);
        let turned = |vector: Vector3<f64>| flip(start.heading.inverse() * vector);
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let reported = turned(report.position - start.position);
        // Half a step of latitude and longitude, whichever way the world is turned.
        let half =
            Vector3::new(report.step.xy().max(), report.step.xy().max(), report.step.z) / 2.0;
        let position = match self.predicted(now) {
            Some(at) if (at.position - reported).norm() < JUMP_M => {
                let least = reported - half;
                at.position.sup(&least).inf(&(reported + half))
            }
            _ => reported,
        };
        self.motion = Some(Motion {
            at: now,
            position,
            velocity: turned(report.velocity),
            attitude: half_turn * start.heading.inverse() * report.attitude * half_turn,
            rate: flip(report.rate),
        });
    }

    /// The motion at `now`; `None` if it is unknown.
    #[must_use]
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

    /// The motion at `now`, predicted from the last sample by its velocity and rate.
    fn predicted(&self, now: Time) -> Option<Motion> {
        let last = self.motion.filter(|last| now.since(last.at) <= SAMPLE_TIMEOUT)?;
        let ahead = now.since(last.at).clamp(Span::ZERO, LONGEST_PREDICTION).seconds();
        Some(Motion {
            at: now,
            position: last.position + last.velocity * ahead,
            attitude: last.attitude * UnitQuaternion::from_scaled_axis(last.rate * ahead),
            ..last
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Time = Time::VIRTUAL_START;

    /// A vehicle that points north-east, at a place of its own.
    fn report() -> ReportedMotion {
        ReportedMotion {
            position: Vector3::new(100.0, -50.0, -584.0),
            step: Vector3::new(0.011, 0.009, 0.0),
            velocity: Vector3::zeros(),
            attitude: UnitQuaternion::from_axis_angle(
                &Vector3::z_axis(),
                std::f64::consts::FRAC_PI_4,
            ),
            rate: Vector3::zeros(),
        }
    }

    fn near(left: [f64; 3], right: [f64; 3]) -> bool {
        left.into_iter().zip(right).all(|(left, right)| (left - right).abs() < 1e-9)
    }

    #[test]
    fn the_first_sample_is_the_origin_and_x_points_forward() {
        let mut observer = MotionObserver::default();
        assert!(observer.truth(START).is_none());
        observer.take(START, &report());
        let truth = observer.truth(START).unwrap();
        assert!(near(truth.position, [0.0; 3]), "{truth:?}");
        assert!((truth.attitude[3].abs() - 1.0).abs() < 1e-12, "{truth:?}");
        // A metre forward, two to the right, three down.
        let step = report().attitude * Vector3::new(1.0, 2.0, 3.0);
        let later = START + Span::from_millis(10);
        let position = report().position + step;
        observer.take(later, &ReportedMotion { position, velocity: step, ..report() });
        let truth = observer.truth(later).unwrap();
        assert!(near(truth.position, [1.0, -2.0, -3.0]), "{truth:?}");
        assert!(near(truth.velocity, [1.0, -2.0, -3.0]), "{truth:?}");
    }

    #[test]
    fn a_turn_about_each_axis_goes_the_right_way() {
        // Right-handed about forward, right, down; seen from forward, left, up the last two are negative.
        for (axis, sign) in [(0, 1.0), (1, -1.0), (2, -1.0)] {
            let mut observer = MotionObserver::default();
            observer.take(START, &report());
            let turn = Vector3::ith(axis, 0.2);
            let attitude = report().attitude * UnitQuaternion::from_scaled_axis(turn);
            observer.take(START, &ReportedMotion { attitude, rate: turn, ..report() });
            let truth = observer.truth(START).unwrap();
            let expected = sign * f64::sin(0.1);
            assert!((truth.attitude[axis] * truth.attitude[3].signum() - expected).abs() < 1e-12);
            assert!((truth.rate[axis] - sign * 0.2).abs() < 1e-12);
        }
    }

    /// Flies at 1 m/s along the heading, sampled at 100 Hz in steps of a centimetre.
    #[test]
    fn steps_of_the_position_are_smoothed_by_the_velocity() {
        let mut observer = MotionObserver::default();
        let forward = report().attitude * Vector3::x();
        let step = report().step;
        let mut worst: f64 = 0.0;
        for sample in 0..300 {
            let now = START + Span::from_millis(10 * sample);
            let travelled = 0.01 * sample as f64;
            let exact = report().position + forward * travelled;
            let position = Vector3::new(
                (exact.x / step.x).floor() * step.x,
                (exact.y / step.y).floor() * step.y,
                exact.z,
            );
            observer.take(now, &ReportedMotion { position, velocity: forward, ..report() });
            let between = now + Span::from_millis(5);
            let truth = observer.truth(between).unwrap();
            if sample > 5 {
                worst = worst.max((truth.position[0] - travelled - 0.005).abs());
            }
        }
        assert!(worst < 0.011, "{worst}");
    }

    #[test]
    fn a_simulator_that_stops_has_no_motion_and_one_that_starts_anew_jumps() {
        let mut observer = MotionObserver::default();
        observer.take(START, &ReportedMotion { velocity: Vector3::x(), ..report() });
        assert!(observer.truth(START + Span::from_millis(250)).is_some());
        assert!(observer.truth(START + Span::from_millis(251)).is_none());
        let moved = report().position + report().attitude * Vector3::new(5.0, 0.0, 0.0);
        let later = START + Span::from_millis(10);
        observer.take(later, &ReportedMotion { position: moved, ..report() });
        assert!(near(observer.truth(later).unwrap().position, [5.0, 0.0, 0.0]));
    }
}
