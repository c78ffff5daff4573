//! Test whether the vehicle moves as its thrust accelerates it: poses that stand still while it must move are frozen, in a hover and in
//! a straight flight at a constant tilt too.
//!
//! A disturbance can hold a vehicle in place against its thrust. But a law learns of the disturbance from the motion alone, so that the
//! vehicle has moved before the thrust counteracts it.

use nalgebra::Vector3;

/// Distance from the first of the poses at which the vehicle does not stand still any more \[m\], and over the noise of the poses \[-\].
const LEAST_RADIUS_M: f64 = 0.003;
const NOISE_RADIUS: f64 = 4.0;
/// Motion by the thrust in which poses that stand still are frozen \[m\], and over that distance \[-\].
const LIMIT_M: f64 = 0.15;
const RADIUS_LIMIT: f64 = 6.0;
/// Rise by the thrust near the floor in which poses that stand still are frozen \[m\]: a vehicle that is heavier than configured stands
/// until its law has raised the thrust.
const RISE_LIMIT_M: f64 = 1.0;
/// Time for which poses must stand still \[s\].
const LEAST_STILL_S: f64 = 0.25;
/// Time constant of the acceleration that balances disturbances and the error of the model \[s\].
const TRIM_S: f64 = 1.0;
/// Corner of the motion by the thrust, so that an error of the model adds up to a distance that is bounded \[rad/s\], and its damping
/// \[-\].
const CORNER_RAD_S: f64 = 3.0;
const DAMPING: f64 = 0.7;

/// The poses that stand still, and the motion by the thrust meanwhile.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StandstillTest {
    /// Acceleration by the thrust in the mean \[m/s^2, world\].
    trim: Option<Vector3<f64>>,
    still: Option<Still>,
}

#[derive(Clone, Copy, Debug)]
struct Still {
    position: Vector3<f64>,
    time_s: f64,
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
        let Some(still) = Still::with(&mut self.still, position, radius_m) else { return 0.0 };
        let stiffness = CORNER_RAD_S * CORNER_RAD_S;
        let damping = 2.0 * DAMPING * CORNER_RAD_S;
        let extra = extra - still.velocity * damping - still.moved * stiffness;
        still.advance(&extra, dt_s);
        let limit_m = LIMIT_M.max(RADIUS_LIMIT * radius_m);
        if still.time_s < LEAST_STILL_S { 0.0 } else { still.moved.norm() / limit_m }
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
        let radius_m = radius_m(deviation_m);
        let Some(still) = Still::with(&mut self.still, position, radius_m) else { return 0.0 };
        still.advance(&(Vector3::z() * lift_m_s2), dt_s);
        if still.velocity.z < 0.0 {
            self.still = None;
            return 0.0;
        }
        still.moved.z / RISE_LIMIT_M
    }
}

fn radius_m(deviation_m: f64) -> f64 {
    LEAST_RADIUS_M + NOISE_RADIUS * deviation_m
}

impl Still {
    /// The standstill, begun at `position` if there is none; `None` if it ends there, farther than `radius_m` from its beginning.
    fn with<'a>(
        still: &'a mut Option<Self>,
        position: &Vector3<f64>,
        radius_m: f64,
    ) -> Option<&'a mut Self> {
        let found = still.get_or_insert(Self::at(position));
        if (position - found.position).norm() <= radius_m {
            return Some(found);
        }
        *found = Self::at(position);
        None
    }

    fn advance(&mut self, acceleration: &Vector3<f64>, dt_s: f64) {
        self.velocity += acceleration * dt_s;
        self.moved += self.velocity * dt_s;
        self.time_s += dt_s;
    }

    fn at(position: &Vector3<f64>) -> Self {
        let (velocity, moved) = (Vector3::zeros(), Vector3::zeros());
        Self { position: *position, time_s: 0.0, velocity, moved }
    }
}
