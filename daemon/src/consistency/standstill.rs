//! Tests whether poses show the motion that the thrust causes: poses that stand still while the vehicle must be moving are frozen, even if
//! the vehicle does not rotate.
//!
//! A disturbance can hold a vehicle in place against its thrust, for example at the end of a motion caused by a push. But the law can
//! detect the disturbance only by the motion, so the vehicle moves before the thrust counteracts it. The same motion reveals the
//! disturbance to this test: a standstill is compared with the thrust that balanced the disturbance when the standstill began. Poses that
//! stand still do not update that balance, and a standstill begins only when the velocity is known.

use nalgebra::Vector3;

use super::motion_observer::MotionObserver;

/// Distance from the mean of the poses above which the vehicle has moved \[m\], and as a multiple of the noise of the poses \[-\]; both are
/// added.
const LEAST_RADIUS_M: f64 = 0.009;
const NOISE_RADIUS: f64 = 4.0;
/// Motion by the thrust at which poses that stand still count as frozen \[m\]; at least this multiple of that distance \[-\].
const LIMIT_M: f64 = 0.145;
const RADIUS_LIMIT: f64 = 8.0;
/// Rise by the thrust after which a vehicle must have left the floor \[m\]: a vehicle that is heavier than configured stands
/// until its law has raised the thrust.
const RISE_LIMIT_M: f64 = 1.0;
/// Time for which poses must stand still \[s\].
const LEAST_STILL_S: f64 = 0.3;
/// Time constant of the acceleration that balances disturbances and the error of the model during a standstill \[s\].
const TRIM_S: f64 = 1.0;
/// Corner of the motion by the thrust, so that an error of the model adds up to a distance that is bounded \[rad/s\], and its damping
/// \[-\].
const CORNER_RAD_S: f64 = 2.5;
const DAMPING: f64 = 0.7;

/// The poses that stand still, and the motion by the thrust meanwhile.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StandstillTest {
    observer: MotionObserver,
    still: Option<Still>,
}

#[derive(Clone, Copy, Debug)]
struct Still {
    /// The first pose \[m, world\].
    begin: Vector3<f64>,
    /// Mean of the poses \[m, world\], and their number \[-\].
    position: Vector3<f64>,
    poses: f64,
    time_s: f64,
    /// The balance at its beginning, and the mean of the acceleration by the thrust from then on \[m/s^2, world\].
    trim: Vector3<f64>,
    /// Velocity \[m/s, world\] and motion \[m, world\] by the thrust.
    velocity: Vector3<f64>,
    moved: Vector3<f64>,
}

impl StandstillTest {
    /// Takes the position \[m, world\] at the end of an interval of `dt_s` \[s\] in the air. `acceleration` is that by the thrust in the
    /// interval, without gravity \[m/s^2, world\]; `deviation_m` is the noise of the position \[m\]. Returns the motion by the thrust that
    /// the poses do not show, as a multiple of its limit \[-\].
    pub(super) fn take(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector3<f64>,
        deviation_m: f64,
        dt_s: f64,
    ) -> f64 {
        let balance = self.observer.balance().copied();
        if let (None, Some(still)) = (balance, &mut self.still) {
            // It began near the floor.
            still.trim = *acceleration;
        }
        let radius_m = radius_m(deviation_m);
        let balance = balance.unwrap_or(*acceleration);
        let begun = Still::at(position, self.observer.velocity(), &balance);
        self.observer.take(position, acceleration, deviation_m, dt_s);
        let Some(still) = self.continued(begun, radius_m) else {
            return 0.0;
        };
        let extra = acceleration - still.trim;
        still.trim += extra * (dt_s / TRIM_S).min(1.0);
        let stiffness = CORNER_RAD_S * CORNER_RAD_S;
        let damping = 2.0 * DAMPING * CORNER_RAD_S;
        let extra = extra - still.velocity * damping - still.moved * stiffness;
        still.advance(&extra, dt_s);
        let limit_m = LIMIT_M.max(RADIUS_LIMIT * radius_m);
        if still.time_s < LEAST_STILL_S { 0.0 } else { still.unseen(position).norm() / limit_m }
    }

    /// Like [`Self::take`], near the floor, where `lift_m_s2` is the acceleration by the thrust beyond gravity \[m/s^2\].
    pub(super) fn take_near_floor(
        &mut self,
        position: &Vector3<f64>,
        lift_m_s2: f64,
        deviation_m: f64,
        dt_s: f64,
    ) -> f64 {
        if lift_m_s2 <= 0.0 {
            // It stands on the floor.
            *self = Self::default();
            return 0.0;
        }
        let radius_m = radius_m(deviation_m);
        let lift = Vector3::z() * lift_m_s2;
        let begun = Still::at(position, self.observer.velocity(), &Vector3::zeros());
        self.observer.take_balanced(position, &lift, deviation_m, dt_s);
        let Some(still) = self.continued(begun, radius_m) else {
            return 0.0;
        };
        still.advance(&lift, dt_s);
        still.moved.z / RISE_LIMIT_M
    }

    /// Begins again after a gap, in which the vehicle may have moved away and back.
    pub(super) fn interrupt(&mut self) {
        let still = self.still.take();
        let balance = self.observer.balance().map(|now| still.map_or(*now, |still| still.trim));
        self.observer.interrupt(balance);
    }

    /// Discards the motion by the thrust: the vehicle is where it is commanded to be.
    pub(super) fn discard_motion(&mut self, position: &Vector3<f64>) {
        if let Some(still) = &mut self.still {
            let (velocity, moved) = (*self.observer.velocity(), Vector3::zeros());
            *still = Still { begin: *position, time_s: 0.0, velocity, moved, ..*still };
        }
    }

    /// The standstill with the pose of `begun`, or `begun` if there is none; `None` if it ends there, further than `radius_m` from the
    /// mean of its poses.
    fn continued(&mut self, begun: Still, radius_m: f64) -> Option<&mut Still> {
        if let Some(found) = &mut self.still {
            let apart = begun.position - found.position;
            if apart.norm() <= radius_m {
                found.poses += 1.0;
                found.position += apart / found.poses;
                return self.still.as_mut();
            }
        }
        self.still = self.observer.is_known().then_some(begun);
        None
    }
}

fn radius_m(deviation_m: f64) -> f64 {
    LEAST_RADIUS_M + NOISE_RADIUS * deviation_m
}

impl Still {
    /// Motion that is not seen at `position` \[m, world\].
    fn unseen(&self, position: &Vector3<f64>) -> Vector3<f64> {
        self.moved - (position - self.begin)
    }

    fn advance(&mut self, acceleration: &Vector3<f64>, dt_s: f64) {
        self.velocity += acceleration * dt_s;
        self.moved += self.velocity * dt_s;
        self.time_s += dt_s;
    }

    fn at(position: &Vector3<f64>, velocity: &Vector3<f64>, trim: &Vector3<f64>) -> Self {
        let (begin, position, moved) = (*position, *position, Vector3::zeros());
        Self { begin, position, poses: 1.0, time_s: 0.0, trim: *trim, velocity: *velocity, moved }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 1.0 / 60.0;
    const GRAVITY: f64 = 9.81;

    /// Greatest evidence in two seconds of hover and one in which the thrust gives the acceleration `extra` besides, if the vehicle
    /// moves by `share` of it.
    fn evidence(extra: Vector3<f64>, share: f64) -> f64 {
        let mut test = StandstillTest::default();
        let (mut position, mut velocity, mut greatest) = (Vector3::z(), Vector3::zeros(), 0.0_f64);
        for tick in 0..180 {
            let extra = if tick < 120 { Vector3::zeros() } else { extra };
            velocity += extra * share * DT_S;
            position += velocity * DT_S;
            let acceleration = Vector3::z() * GRAVITY + extra;
            greatest = greatest.max(test.take(&position, &acceleration, 0.5e-3, DT_S));
        }
        greatest
    }

    #[test]
    fn poses_that_do_not_follow_the_thrust_are_found_and_those_that_do_are_not() {
        for extra in [Vector3::x() * 2.6, Vector3::y() * -2.6, Vector3::z() * 2.0] {
            assert!(evidence(extra, 0.0) > 1.0, "{extra}");
            for share in [0.7, 1.0, 1.4] {
                assert!(evidence(extra, share) < 0.5, "{extra} by {share}");
            }
        }
    }

    /// A push of 4 m/s^2 moves the vehicle by 11 cm, where the thrust holds it.
    #[test]
    fn a_vehicle_that_a_push_moves_and_its_thrust_then_holds_is_not_frozen() {
        let mut test = StandstillTest::default();
        let (mut moved_m, mut speed_m_s, mut thrust_m_s2) = (0.0, 0.0, GRAVITY);
        for tick in 0..240 {
            let push_m_s2 = if tick < 120 { 0.0 } else { 4.0 };
            let wanted_m_s2 = GRAVITY - 36.0 * moved_m - 12.0 * speed_m_s;
            thrust_m_s2 += (wanted_m_s2 - thrust_m_s2) * DT_S / 0.05;
            speed_m_s += (thrust_m_s2 + push_m_s2 - GRAVITY) * DT_S;
            moved_m += speed_m_s * DT_S;
            let [position, acceleration] = [1.0 + moved_m, thrust_m_s2].map(|z| Vector3::z() * z);
            let evidence = test.take(&position, &acceleration, 0.5e-3, DT_S);
            assert!(evidence < 0.5, "{evidence} after {tick} ticks at {moved_m} m");
        }
        assert!(moved_m > 0.1 && thrust_m_s2 < GRAVITY - 3.9, "{moved_m} m, {thrust_m_s2} m/s^2");
    }

    /// One pose in five is off by 5 cm, in a hover and at a constant speed; then the poses freeze while the thrust accelerates.
    #[test]
    fn outliers_do_not_count_as_motion_nor_hide_frozen_poses() {
        for (speed_m_s, first) in [(0.0, 0), (0.0, 1), (0.3, 2), (0.3, 3)] {
            let mut test = StandstillTest::default();
            let mut greatest = [0.0_f64; 2];
            for tick in 0..240 {
                let is_frozen = tick >= 180;
                let way_m = speed_m_s * DT_S * f64::from(tick.min(180));
                let off_m = if !is_frozen && tick % 5 == first { 0.05 } else { 0.0 };
                let side = if tick % 2 == 0 { Vector3::y() } else { -Vector3::z() };
                let position = Vector3::x() * way_m + side * off_m;
                let extra = if is_frozen { 2.6 } else { 0.0 };
                let acceleration = Vector3::new(extra, 0.0, GRAVITY);
                let evidence = test.take(&position, &acceleration, 0.5e-3, DT_S);
                let greatest = &mut greatest[usize::from(is_frozen)];
                *greatest = greatest.max(evidence);
            }
            assert!(greatest[0] < 0.3 && greatest[1] > 1.0, "{greatest:?}");
        }
    }

    #[test]
    fn a_vehicle_near_the_floor_must_rise_with_its_thrust() {
        let rise = |lift_m_s2: f64, climbs: bool| {
            let mut test = StandstillTest::default();
            let of_tick = |tick: i32| {
                let t_s = DT_S * f64::from(tick);
                let z = if climbs { 0.5 * lift_m_s2 * t_s * t_s } else { 0.0 };
                test.take_near_floor(&(Vector3::z() * z), lift_m_s2, 0.5e-3, DT_S)
            };
            (0..60).map(of_tick).fold(0.0, f64::max)
        };
        assert!(rise(3.0, false) > 1.0);
        assert!(rise(-3.0, false) == 0.0 && rise(3.0, true) < 0.2);
    }
}
