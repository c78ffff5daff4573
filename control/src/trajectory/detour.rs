//! Changes of a flight under way: a smooth leg to rest at a point, and a trajectory flown from there.

use nalgebra::{UnitQuaternion, Vector3, Vector4};

use super::path::{Trajectory, TrajectoryShape};
use super::reference::{Phase, Reference};
use crate::euler::shorter_turn;
use crate::quaternion::Attitude;

/// Least duration of a leg \[s\].
const LEAST_DURATION_S: f64 = 0.5;
/// Points at which a leg is compared with its limits \[-\].
const CHECKED_POINTS: u32 = 32;
/// Factor by which a leg above its limits is prolonged, and the greatest number of times \[-\].
const PROLONGED: (f64, u32) = (1.15, 40);
/// Time in which an acceleration at the limit goes to zero at the beginning of a leg \[s\].
const RELEASE_S: f64 = 0.5;
/// Share of the greatest acceleration with which the motion of the start is stopped; the rest is for the way, which begins at the same
/// time \[-\].
const STOP_SHARE: f64 = 0.7;
/// Tolerance of the limits \[-\].
const TOLERANCE: f64 = 1.0 + 1e-6;

/// Greatest speeds and acceleration of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegLimits {
    /// Horizontal speed \[m/s\].
    pub horizontal_m_s: f64,
    /// Vertical speed \[m/s\].
    pub vertical_m_s: f64,
    /// Acceleration \[m/s^2\].
    pub acceleration_m_s2: f64,
    /// Rate of the yaw \[rad/s\].
    pub yaw_rate_rad_s: f64,
}

/// The motion of a reference at one instant: x, y, z \[m, world\] and 3-2-1 yaw \[rad\] with their first two derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferenceMotion {
    /// Position and yaw \[m, world; rad\].
    pub value: Vector4<f64>,
    /// First derivative \[m/s; rad/s\].
    pub rate: Vector4<f64>,
    /// Second derivative \[m/s^2; rad/s^2\].
    pub acceleration: Vector4<f64>,
}

impl ReferenceMotion {
    /// The motion at the second of two references, `dt_s` \[s\] apart. Velocities that jump have no acceleration.
    pub fn between(before: &Reference, now: &Reference, dt_s: f64) -> Self {
        let yaw_rate = shorter_turn(now.yaw_rad - before.yaw_rad) / dt_s;
        let acceleration = (now.velocity - before.velocity) / dt_s;
        Self {
            value: now.position.push(now.yaw_rad),
            rate: now.velocity.push(yaw_rate),
            acceleration: acceleration.push(0.0),
        }
    }

    /// The reference of this motion, with its acceleration.
    pub fn reference(&self) -> Reference {
        Reference {
            velocity: self.rate.xyz(),
            acceleration: self.acceleration.xyz(),
            yaw_rad: self.value.w,
            yaw_rate_rad_s: self.rate.w,
            yaw_acceleration_rad_s2: self.acceleration.w,
            ..Reference::rest(self.value.xyz(), Phase::Trajectory)
        }
    }

    /// The motion `dt_s` \[s\] later at constant acceleration.
    pub fn after(&self, dt_s: f64) -> Self {
        let Self { value, rate, acceleration } = *self;
        let value = value + (rate + acceleration * (dt_s / 2.0)) * dt_s;
        Self { value, rate: rate + acceleration * dt_s, acceleration }
    }

    /// The motion `t_s` \[s\] later if the acceleration decreases to zero at a constant rate within `release_s` \[s\]; `t_s` is at most
    /// `release_s`.
    fn at_release(&self, t_s: f64, release_s: f64) -> Self {
        let Self { value, rate, acceleration } = *self;
        let share = t_s / release_s;
        Self {
            value: value + (rate + acceleration * (t_s * (0.5 - share / 6.0))) * t_s,
            rate: rate + acceleration * (t_s * (1.0 - share / 2.0)),
            acceleration: acceleration * (1.0 - share),
        }
    }

    /// The same motion with accelerations of at most `limit` \[m/s^2, rad/s^2\].
    fn within(&self, limit: f64) -> Self {
        let acceleration = self.acceleration.map(|value| value.clamp(-limit, limit));
        Self { acceleration, ..*self }
    }
}

/// A leg from a motion to rest at a point: the sum of a stop from that motion, which does not turn back, and of a way from rest to rest,
/// which begin together. A single polynomial would continue the initial motion over the whole leg: a descending vehicle that is sent far
/// away would reach the floor.
///
/// The acceleration of the start is released first: a polynomial that begins with it exceeds the limits the more, the longer it
/// lasts. Stop and way are polynomials of fifth degree in each coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    start: ReferenceMotion,
    /// Time in which the acceleration of the start is released \[s\].
    release_s: f64,
    /// The motion at the end of the release.
    released: ReferenceMotion,
    /// Duration of the stop after the release \[s\].
    stop_s: f64,
    /// The way from the point of the stop to the target \[m, world; rad\].
    way: Vector4<f64>,
    /// Duration of the way from the end of the release \[s\]; 0 for a stop.
    way_s: f64,
}

impl Leg {
    /// The leg from `from` to rest at `target` (x, y, z \[m, world\] and yaw \[rad\]; yaw turns the shorter way).
    pub fn to(from: &ReferenceMotion, target: &Vector4<f64>, limits: &LegLimits) -> Self {
        let stop = Self::stop_with(STOP_SHARE, from, limits);
        let mut way = target - stop.motion(stop.duration_s()).value;
        way.w = shorter_turn(way.w);
        prolonged(limits, |way_s| Self { way, way_s, ..stop })
    }

    /// The leg from `from` to rest, along the present motion.
    pub fn stop(from: &ReferenceMotion, limits: &LegLimits) -> Self {
        Self::stop_with(1.0, from, limits)
    }

    /// A stop that, after the release, uses this share of the acceleration.
    fn stop_with(share: f64, from: &ReferenceMotion, limits: &LegLimits) -> Self {
        let start = from.within(limits.acceleration_m_s2);
        let release_s = RELEASE_S * start.acceleration.norm() / limits.acceleration_m_s2;
        let released = if release_s > 0.0 { start.at_release(release_s, release_s) } else { start };
        let acceleration_m_s2 = share * limits.acceleration_m_s2;
        let (way, way_s) = (Vector4::zeros(), 0.0);
        prolonged(&LegLimits { acceleration_m_s2, ..*limits }, |stop_s| Self {
            start,
            release_s,
            released,
            stop_s,
            way,
            way_s,
        })
    }

    /// Whether the leg stays within `limits`, or within the speed and the acceleration with which the stop or the release begins.
    fn is_within(&self, limits: &LegLimits) -> bool {
        let beyond = |value: f64, limit: f64, begins: f64| value > limit.max(begins) * TOLERANCE;
        let pulled = self.start.acceleration.xyz().norm();
        (0..=CHECKED_POINTS).all(|index| {
            let motion =
                self.motion(self.duration_s() * f64::from(index) / f64::from(CHECKED_POINTS));
            let begins = |part: fn(&Vector4<f64>) -> f64| {
                part(&self.start.rate).max(part(&self.released.rate))
            };
            let level = |rate: &Vector4<f64>| rate.xy().norm();
            let (up, turn) =
                (|rate: &Vector4<f64>| rate.z.abs(), |rate: &Vector4<f64>| rate.w.abs());
            !(beyond(level(&motion.rate), limits.horizontal_m_s, begins(level))
                || beyond(up(&motion.rate), limits.vertical_m_s, begins(up))
                || beyond(turn(&motion.rate), limits.yaw_rate_rad_s, begins(turn))
                || beyond(motion.acceleration.xyz().norm(), limits.acceleration_m_s2, pulled))
        })
    }

    /// Duration \[s\].
    pub fn duration_s(&self) -> f64 {
        self.release_s + self.stop_s.max(self.way_s)
    }

    /// The motion at `t_s` \[s\] after the start of the leg; at rest after its end.
    pub fn motion(&self, t_s: f64) -> ReferenceMotion {
        if t_s < self.release_s {
            return self.start.at_release(t_s.max(0.0), self.release_s);
        }
        let since_s = t_s - self.release_s;
        let ReferenceMotion { value, rate, .. } = self.released;
        // A rise by half of the speed times the duration leaves out the fifth degree: the velocity does not change its sign.
        let [share, speed, acceleration] = shares(since_s, self.stop_s, [0.0, 1.0, 0.5]);
        let stop = ReferenceMotion {
            value: value + rate * (share * self.stop_s),
            rate: rate * speed,
            acceleration: rate * (acceleration / self.stop_s),
        };
        if self.way_s == 0.0 {
            return stop;
        }
        let [share, speed, acceleration] = shares(since_s, self.way_s, [0.0, 0.0, 1.0]);
        ReferenceMotion {
            value: stop.value + self.way * share,
            rate: stop.rate + self.way * (speed / self.way_s),
            acceleration: stop.acceleration + self.way * (acceleration / self.way_s.powi(2)),
        }
    }
}

/// The shortest leg found within `limits`, or the longest one tried; `lasting` makes the leg of a duration \[s\].
fn prolonged(limits: &LegLimits, lasting: impl Fn(f64) -> Leg) -> Leg {
    let mut duration_s = LEAST_DURATION_S;
    let mut leg = lasting(duration_s);
    for _ in 0..PROLONGED.1 {
        if leg.is_within(limits) {
            break;
        }
        duration_s *= PROLONGED.0;
        leg = lasting(duration_s);
    }
    leg
}

/// Value and first two derivatives at `t_s` \[s\] of the polynomial of fifth degree that goes in `duration_s` \[s\] from `start` with
/// the slope `rate`, without acceleration, to rest at `end`. The derivatives are by `t_s / duration_s` \[-\].
fn shares(t_s: f64, duration_s: f64, [start, rate, end]: [f64; 3]) -> [f64; 3] {
    let t = t_s / duration_s;
    if t >= 1.0 {
        return [end, 0.0, 0.0];
    }
    let rise = end - start;
    let cubic = rise * 10.0 - rate * 6.0;
    let quartic = rise * -15.0 + rate * 8.0;
    let quintic = rise * 6.0 - rate * 3.0;
    [
        start + (rate + (cubic + (quartic + quintic * t) * t) * t * t) * t,
        rate + (cubic * 3.0 + (quartic * 4.0 + quintic * (5.0 * t)) * t) * t * t,
        (cubic * 6.0 + (quartic * 12.0 + quintic * (20.0 * t)) * t) * t,
    ]
}

/// A change of a flight: a leg, and the trajectory that is flown after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Detour {
    leg: Leg,
    /// The trajectory, and its origin with the zero of its yaw \[m, world; rad\].
    then: Option<(Trajectory, Vector4<f64>)>,
}

impl Detour {
    /// A goto, or a stop: the flight stays at the end of `leg`.
    pub fn stay(leg: Leg) -> Self {
        Self { leg, then: None }
    }

    /// Flies `trajectory` from the point at which a vehicle in the motion `from` comes to rest. Waypoints are relative to `start`,
    /// the start of the flight \[m, world; rad\].
    pub fn fly(
        trajectory: Trajectory,
        from: &ReferenceMotion,
        start: &Vector4<f64>,
        limits: &LegLimits,
    ) -> Self {
        let first = trajectory.sample(0.0);
        let first = first.position.push(first.yaw_rad);
        if let TrajectoryShape::Waypoints(_) = trajectory.shape {
            let leg = Leg::to(from, &(start + first), limits);
            return Self { leg, then: Some((trajectory, *start)) };
        }
        let leg = Leg::stop(from, limits);
        let origin = leg.motion(leg.duration_s()).value - first;
        Self { leg, then: Some((trajectory, origin)) }
    }

    /// Duration of the leg and of the trajectory that follows it \[s\].
    pub fn duration_s(&self) -> f64 {
        let then_s = self.then.as_ref().map_or(0.0, |(trajectory, _)| trajectory.duration_s());
        self.leg.duration_s() + then_s
    }

    /// The reference `t_s` \[s\] after the start of the detour.
    pub fn sample(&self, t_s: f64) -> Reference {
        match &self.then {
            Some((trajectory, origin)) if t_s >= self.leg.duration_s() => {
                placed(trajectory.sample(t_s - self.leg.duration_s()), origin)
            }
            _ => self.leg.motion(t_s).reference(),
        }
    }
}

/// `reference`, whose origin and zero of the yaw are `origin` \[m, world; rad\].
pub(super) fn placed(reference: Reference, origin: &Vector4<f64>) -> Reference {
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), origin.w);
    let attitude = reference.attitude.map(|mut prescribed| {
        let turned = heading * prescribed.attitude.unit_quaternion();
        prescribed.attitude = Attitude::from_unit_quaternion(turned);
        prescribed
    });
    let position = reference.position + origin.xyz();
    Reference { position, yaw_rad: reference.yaw_rad + origin.w, attitude, ..reference }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: LegLimits = LegLimits {
        horizontal_m_s: 0.6,
        vertical_m_s: 0.4,
        acceleration_m_s2: 1.0,
        yaw_rate_rad_s: 0.8,
    };

    fn vector(range: f64) -> impl Strategy<Value = Vector4<f64>> {
        prop::array::uniform4(-range..range).prop_map(Vector4::from)
    }

    proptest! {
        #[test]
        fn a_leg_continues_its_start_ends_at_rest_at_its_target_and_keeps_its_limits(
            value in vector(3.0), rate in vector(0.35), acceleration in vector(0.55), target in vector(3.0)
        ) {
            let from = ReferenceMotion { value, rate, acceleration };
            let leg = Leg::to(&from, &target, &LIMITS);
            let (begins, ends) = (leg.motion(0.0), leg.motion(leg.duration_s() + 1.0));
            prop_assert!((begins.value - value).norm() < 1e-12);
            prop_assert!((begins.rate - rate).norm() < 1e-12);
            prop_assert!((begins.acceleration - acceleration).norm() < 1e-12);
            prop_assert!((ends.value - target).xyz().norm() < 1e-9);
            let turn = ends.value.w - target.w;
            prop_assert!(turn.sin().abs() < 1e-9 && turn.cos() > 0.0);
            for index in 0..=200 {
                let motion = leg.motion(leg.duration_s() * f64::from(index) / 200.0);
                prop_assert!(motion.rate.xy().norm() < 0.7 && motion.rate.z.abs() < 0.5);
                prop_assert!(motion.acceleration.xyz().norm() < 1.1);
            }
        }

        /// A leg stays between start, target and the point of the stop on every axis, however far the target is.
        #[test]
        fn a_leg_goes_no_farther_than_its_stop_and_its_target(
            rate in vector(0.4), acceleration in vector(0.55), target in vector(8.0)
        ) {
            let from = ReferenceMotion { rate, acceleration, ..ReferenceMotion::default() };
            let stop = Leg::stop_with(STOP_SHARE, &from, &LIMITS);
            let leg = Leg::to(&from, &target, &LIMITS);
            let points = |leg: &Leg| (0..=200).map(|index| {
                leg.motion(leg.duration_s() * f64::from(index) / 200.0).value
            }).collect::<Vec<_>>();
            let (stop, way) = (points(&stop), points(&leg));
            for axis in 0..3 {
                let bound = |least: fn(f64, f64) -> f64| {
                    stop.iter().map(|point| point[axis]).fold(target[axis], least)
                };
                for point in &way {
                    let (low, high) = (bound(f64::min) - 1e-4, bound(f64::max) + 1e-4);
                    prop_assert!((low..=high).contains(&point[axis]), "{axis}: {}", point[axis]);
                }
            }
        }

        #[test]
        fn a_stop_does_not_turn_back(rate in vector(0.35)) {
            let from = ReferenceMotion { rate, ..ReferenceMotion::default() };
            let leg = Leg::stop(&from, &LIMITS);
            for index in 0..=50 {
                let motion = leg.motion(leg.duration_s() * f64::from(index) / 50.0);
                prop_assert!(motion.rate.dot(&rate) >= -1e-12);
            }
            prop_assert_eq!(leg.motion(leg.duration_s()).rate, Vector4::zeros());
        }
    }
}
