//! Changes of a flight under way: a smooth leg to rest at a point, and a trajectory flown from there.

use nalgebra::{UnitQuaternion, Vector3, Vector4};

use super::path::{Trajectory, TrajectoryShape};
use super::reference::{Phase, Reference};
use crate::quaternion::Attitude;

/// Least duration of a leg \[s\].
const LEAST_DURATION_S: f64 = 0.5;
/// Points at which a leg is compared with its limits \[-\].
const CHECKED_POINTS: u32 = 32;
/// Factor by which a leg above its limits is prolonged, and the greatest number of times \[-\].
const PROLONGED: (f64, u32) = (1.15, 40);
/// Time in which an acceleration at the limit goes to zero at the beginning of a leg \[s\].
const RELEASE_S: f64 = 0.5;
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
        let turn = now.yaw_rad - before.yaw_rad;
        let yaw_rate = turn.sin().atan2(turn.cos()) / dt_s;
        let acceleration = (now.velocity - before.velocity) / dt_s;
        Self {
            value: now.position.push(now.yaw_rad),
            rate: now.velocity.push(yaw_rate),
            acceleration: acceleration.push(0.0),
        }
    }

    /// The motion `dt_s` \[s\] later at constant acceleration.
    pub fn after(&self, dt_s: f64) -> Self {
        let Self { value, rate, acceleration } = *self;
        let value = value + (rate + acceleration * (dt_s / 2.0)) * dt_s;
        Self { value, rate: rate + acceleration * dt_s, acceleration }
    }

    /// The motion `t_s` \[s\] later if the acceleration goes to zero at a constant rate within `release_s` \[s\], which is not before.
    fn released(&self, t_s: f64, release_s: f64) -> Self {
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

/// A leg from a motion to rest. The acceleration of the start is released first: a polynomial that begins with it exceeds the limits
/// the more, the longer it lasts. Then follows in each coordinate the polynomial of fifth degree from that motion to rest without
/// acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    start: ReferenceMotion,
    /// Time in which the acceleration of the start is released \[s\].
    release_s: f64,
    /// Duration of the polynomial \[s\].
    polynomial_s: f64,
    /// Coefficients of the powers of time, the lowest first.
    coefficients: [Vector4<f64>; 6],
}

impl Leg {
    /// The leg from `from` to rest at `target` (x, y, z \[m, world\] and yaw \[rad\]; yaw turns the shorter way).
    pub fn to(from: &ReferenceMotion, target: &Vector4<f64>, limits: &LegLimits) -> Self {
        Self::shortest(from, limits, |from, _| {
            let mut rise = target - from.value;
            rise.w = rise.w.sin().atan2(rise.w.cos());
            rise
        })
    }

    /// The leg from `from` to rest, along the present motion.
    pub fn stop(from: &ReferenceMotion, limits: &LegLimits) -> Self {
        // With this rise the term of fifth degree vanishes, and the velocity does not change its sign.
        Self::shortest(from, limits, |from, t_s| from.rate * (t_s / 2.0))
    }

    /// The shortest leg found within `limits`; `rise` is the way of the polynomial from its first motion, by its duration \[s\].
    fn shortest(
        from: &ReferenceMotion,
        limits: &LegLimits,
        rise: impl Fn(&ReferenceMotion, f64) -> Vector4<f64>,
    ) -> Self {
        let start = from.within(limits.acceleration_m_s2);
        let release_s = RELEASE_S * start.acceleration.norm() / limits.acceleration_m_s2;
        let first = if release_s > 0.0 { start.released(release_s, release_s) } else { start };
        let lasting = |polynomial_s: f64| {
            let coefficients = to_rest(&first, &rise(&first, polynomial_s), polynomial_s);
            Self { start, release_s, polynomial_s, coefficients }
        };
        let mut leg = lasting(LEAST_DURATION_S);
        for _ in 0..PROLONGED.1 {
            if leg.is_within(limits) {
                break;
            }
            leg = lasting(leg.polynomial_s * PROLONGED.0);
        }
        leg
    }

    /// Whether the leg stays within `limits`, or within the speed and the acceleration with which its polynomial or the release begins.
    fn is_within(&self, limits: &LegLimits) -> bool {
        let (from, first) = (&self.start, self.motion(self.release_s).rate);
        let beyond = |value: f64, limit: f64, begins: f64| value > limit.max(begins) * TOLERANCE;
        let pulled = from.acceleration.xyz().norm();
        (0..=CHECKED_POINTS).all(|index| {
            let motion =
                self.motion(self.duration_s() * f64::from(index) / f64::from(CHECKED_POINTS));
            let begins = |part: fn(&Vector4<f64>) -> f64| part(&from.rate).max(part(&first));
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
        self.release_s + self.polynomial_s
    }

    /// The motion at `t_s` \[s\] after the start of the leg; at rest after its end.
    pub fn motion(&self, t_s: f64) -> ReferenceMotion {
        if t_s < self.release_s {
            return self.start.released(t_s.max(0.0), self.release_s);
        }
        let t = (t_s - self.release_s).clamp(0.0, self.polynomial_s);
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let value = c0 + (c1 + (c2 + (c3 + (c4 + c5 * t) * t) * t) * t) * t;
        if t_s >= self.duration_s() {
            return ReferenceMotion { value, ..ReferenceMotion::default() };
        }
        ReferenceMotion {
            value,
            rate: c1 + (c2 * 2.0 + (c3 * 3.0 + (c4 * 4.0 + c5 * (5.0 * t)) * t) * t) * t,
            acceleration: c2 * 2.0 + (c3 * 6.0 + (c4 * 12.0 + c5 * (20.0 * t)) * t) * t,
        }
    }
}

/// Coefficients of the polynomial from the rate of `from`, without acceleration, by `rise` to rest after `t_s` \[s\].
fn to_rest(from: &ReferenceMotion, rise: &Vector4<f64>, t_s: f64) -> [Vector4<f64>; 6] {
    let speed = from.rate * t_s;
    let cubic = (rise * 10.0 - speed * 6.0) / t_s.powi(3);
    let quartic = (rise * -15.0 + speed * 8.0) / t_s.powi(4);
    let quintic = (rise * 6.0 - speed * 3.0) / t_s.powi(5);
    [from.value, from.rate, Vector4::zeros(), cubic, quartic, quintic]
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

    /// Duration of leg and trajectory \[s\].
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
            _ => {
                let ReferenceMotion { value, rate, .. } = self.leg.motion(t_s);
                Reference {
                    velocity: rate.xyz(),
                    yaw_rad: value.w,
                    ..Reference::rest(value.xyz(), Phase::Trajectory)
                }
            }
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
            value in vector(3.0), rate in vector(0.35), acceleration in vector(0.1), target in vector(3.0)
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
