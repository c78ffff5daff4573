//! Test whether the vehicle moves as its thrust accelerates it: poses that stand still while it must move are frozen, also where the
//! vehicle does not rotate.
//!
//! A disturbance can hold a vehicle in place against its thrust. But a law learns of the disturbance from the motion alone, so the
//! vehicle moves before the thrust counteracts it.

use nalgebra::Vector3;

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
/// Time constant of the acceleration that balances disturbances and the error of the model \[s\].
const TRIM_S: f64 = 1.0;
/// Time constant of the velocity by the positions \[s\].
const VELOCITY_S: f64 = 0.08;
/// Greatest correction of the velocity by one pose, over its time constant \[m/s\].
const GREATEST_STEP_M_S: f64 = 0.4;
/// Corner of the motion by the thrust, so that an error of the model adds up to a distance that is bounded \[rad/s\], and its damping
/// \[-\].
const CORNER_RAD_S: f64 = 2.5;
const DAMPING: f64 = 0.7;

/// The poses that stand still, and the motion by the thrust meanwhile.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StandstillTest {
    /// Acceleration by the thrust in the mean \[m/s^2, world\].
    trim: Option<Vector3<f64>>,
    /// The last position \[m, world\], and the velocity \[m/s, world\] by positions and thrust.
    last: Option<Vector3<f64>>,
    velocity: Vector3<f64>,
    /// Time until the velocity is known again after a gap \[s\].
    unknown_s: f64,
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
    /// Velocity \[m/s, world\] and motion \[m, world\] by the thrust.
    velocity: Vector3<f64>,
    moved: Vector3<f64>,
}

impl StandstillTest {
    /// Takes the position \[m, world\] after an interval of `dt_s` \[s\] in the air in which the thrust gave `acceleration`
    /// \[m/s^2, world\], gravity not subtracted; `deviation_m` is the noise of the position \[m\]. Returns the motion that is not
    /// seen, over its limit \[-\].
    pub(super) fn take(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector3<f64>,
        deviation_m: f64,
        dt_s: f64,
    ) -> f64 {
        let trim = self.trim.get_or_insert(*acceleration);
        let extra = acceleration - *trim;
        *trim += extra * (dt_s / TRIM_S).min(1.0);
        let radius_m = radius_m(deviation_m);
        let velocity = self.update_velocity(position, &extra, dt_s);
        let Some(still) = Still::with(&mut self.still, position, &velocity, radius_m) else {
            return 0.0;
        };
        let stiffness = CORNER_RAD_S * CORNER_RAD_S;
        let damping = 2.0 * DAMPING * CORNER_RAD_S;
        let extra = extra - still.velocity * damping - still.moved * stiffness;
        still.advance(&extra, dt_s);
        let limit_m = LIMIT_M.max(RADIUS_LIMIT * radius_m);
        if still.time_s < LEAST_STILL_S { 0.0 } else { still.unseen(position).norm() / limit_m }
    }

    /// As [`Self::take`], near the floor, where `lift_m_s2` is the acceleration by the thrust beyond gravity \[m/s^2\].
    pub(super) fn take_near_floor(
        &mut self,
        position: &Vector3<f64>,
        lift_m_s2: f64,
        deviation_m: f64,
        dt_s: f64,
    ) -> f64 {
        self.trim = None;
        if lift_m_s2 <= 0.0 {
            // It stands on the floor.
            *self = Self::default();
            return 0.0;
        }
        let radius_m = radius_m(deviation_m);
        let lift = Vector3::z() * lift_m_s2;
        let velocity = self.update_velocity(position, &lift, dt_s);
        let Some(still) = Still::with(&mut self.still, position, &velocity, radius_m) else {
            return 0.0;
        };
        still.advance(&lift, dt_s);
        still.moved.z / RISE_LIMIT_M
    }

    /// Begins again after a gap, in which the vehicle may have moved away and back.
    pub(super) fn interrupt(&mut self) {
        (self.still, self.last, self.unknown_s) = (None, None, 2.0 * VELOCITY_S);
    }

    /// Ends the standstill: the vehicle is where it is commanded to be.
    pub(super) fn end(&mut self) {
        self.still = None;
    }

    /// Updates the velocity by `position`; returns the one before \[m/s, world\].
    fn update_velocity(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector3<f64>,
        dt_s: f64,
    ) -> Vector3<f64> {
        let before = self.velocity;
        let last = self.last.replace(*position).unwrap_or(*position);
        // An outlier of the poses is bounded.
        let step = ((position - last) / dt_s - before).cap_magnitude(GREATEST_STEP_M_S);
        self.velocity += acceleration * dt_s + step * (dt_s / VELOCITY_S).min(1.0);
        self.unknown_s -= dt_s;
        if self.unknown_s > 0.0 {
            self.still = None;
        }
        before
    }
}

fn radius_m(deviation_m: f64) -> f64 {
    LEAST_RADIUS_M + NOISE_RADIUS * deviation_m
}

impl Still {
    /// The standstill, begun at `position` with the velocity before it if there is none; `None` if it ends there, further than
    /// `radius_m` from the mean of its poses.
    fn with<'a>(
        still: &'a mut Option<Self>,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        radius_m: f64,
    ) -> Option<&'a mut Self> {
        let found = still.get_or_insert(Self::at(position, velocity));
        let apart = position - found.position;
        if apart.norm() <= radius_m {
            found.poses += 1.0;
            found.position += apart / found.poses;
            return Some(found);
        }
        *found = Self::at(position, velocity);
        None
    }

    /// Motion that is not seen at `position` \[m, world\].
    fn unseen(&self, position: &Vector3<f64>) -> Vector3<f64> {
        self.moved - (position - self.begin)
    }

    fn advance(&mut self, acceleration: &Vector3<f64>, dt_s: f64) {
        self.velocity += acceleration * dt_s;
        self.moved += self.velocity * dt_s;
        self.time_s += dt_s;
    }

    fn at(position: &Vector3<f64>, velocity: &Vector3<f64>) -> Self {
        let (begin, position, moved) = (*position, *position, Vector3::zeros());
        Self { begin, position, poses: 1.0, time_s: 0.0, velocity: *velocity, moved }
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
