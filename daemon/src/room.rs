//! The room of a flight: the space between the floor and the soft border of the fence, and the stops that stay inside.

use nalgebra::Vector3;
use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::trajectory::{Detour, Leg, LegLimits, ReferenceMotion};

use crate::fence::{Braking, Fence};
use crate::floor::LEAST_WAY_M;

/// Time between two points at which a detour is compared with the room \[s\], and their greatest number \[-\].
const DETOUR_STEP_S: f64 = 0.1;
const MOST_DETOUR_POINTS: f64 = 1000.0;
/// Number of intervals between the points at which a stop is compared with the room \[-\].
const STOP_POINTS: u32 = 16;
/// Ratio of successive accelerations with which a stop is tried \[-\].
const HARDER: f64 = 1.25;
/// Height by which a way that begins near the floor may go below its beginning \[m\].
const TOLERANCE_M: f64 = 1e-6;

/// The room of a flight. No method allocates.
#[derive(Clone, Debug)]
pub struct StoppingRoom {
    fence: Fence,
    legs: LegLimits,
    braking: Braking,
    /// Height of the floor on which the flight began \[m, world z\].
    floor_m: f64,
}

impl StoppingRoom {
    /// The room of `config`, above a floor at the height 0.
    pub fn new(config: &Config) -> Self {
        let options = &config.reference;
        let legs = LegLimits {
            horizontal_m_s: options.leg_horizontal_m_s,
            vertical_m_s: options.leg_vertical_m_s,
            acceleration_m_s2: options.leg_acceleration_m_s2,
            yaw_rate_rad_s: options.leg_yaw_rate_deg_s.to_radians(),
        };
        let (fence, braking) = (Fence::new(&config.fence), Braking::of(config));
        Self { fence, legs, braking, floor_m: 0.0 }
    }

    /// Begins a flight from the floor at `floor_m` \[m, world z\].
    pub fn begin_flight(&mut self, floor_m: f64) {
        self.floor_m = floor_m;
    }

    /// Exchanges the settings with those of `other`; the floor is kept.
    pub fn exchange(&mut self, other: &mut Self) {
        std::mem::swap(self, other);
        std::mem::swap(&mut self.floor_m, &mut other.floor_m);
    }

    /// The limits of legs.
    pub fn legs(&self) -> &LegLimits {
        &self.legs
    }

    /// Whether `position` \[m, world\] is inside the soft border of the fence and high enough above the floor.
    pub fn contains(&self, position: &Vector3<f64>) -> bool {
        // Comparisons with NaN are false.
        self.fence.inside_soft_m(position) > 0.0 && position.z >= self.least_m()
    }

    /// Least height of a reference \[m, world z\].
    pub fn least_m(&self) -> f64 {
        self.floor_m + LEAST_WAY_M
    }

    /// The stop from the motion `from`: with the acceleration of `[reference]` if that has room, otherwise with a greater one, as the
    /// room requires, up to the greatest of the vehicle.
    pub fn stop(&self, from: &ReferenceMotion) -> Leg {
        let hardest = self.hardest_m_s2(from);
        let mut acceleration_m_s2 = self.legs.acceleration_m_s2;
        loop {
            let leg = Leg::stop(from, &LegLimits { acceleration_m_s2, ..self.legs });
            // A comparison with NaN is false.
            let may_brake_harder = acceleration_m_s2 < hardest;
            if !may_brake_harder || self.has_room(&leg) {
                return leg;
            }
            acceleration_m_s2 = (acceleration_m_s2 * HARDER).min(hardest);
        }
    }

    /// Whether the hardest stop from the motion `from` has room.
    pub fn has_stop(&self, from: &ReferenceMotion) -> bool {
        let acceleration_m_s2 = self.hardest_m_s2(from);
        self.has_room(&Leg::stop(from, &LegLimits { acceleration_m_s2, ..self.legs }))
    }

    /// Greatest deceleration of a vehicle in this motion \[m/s^2\].
    fn hardest_m_s2(&self, motion: &ReferenceMotion) -> f64 {
        self.braking.along(&motion.rate.xyz())
    }

    /// Whether a vehicle that follows the stop `leg` stays inside, although it reacts late.
    fn has_room(&self, leg: &Leg) -> bool {
        let late = leg.motion(0.0).rate.xyz() * self.braking.reaction_s;
        (0..=STOP_POINTS).all(|index| {
            let t_s = leg.duration_s() * f64::from(index) / f64::from(STOP_POINTS);
            self.contains(&(leg.motion(t_s).value.xyz() + late))
        })
    }

    /// Requires that `detour`, which begins at the height `from_m` \[m, world z\], stays inside.
    ///
    /// # Errors
    /// It leaves the soft border of the fence, or comes close to the floor.
    pub fn require(&self, detour: &Detour, from_m: f64) -> Result<(), Cause> {
        // A way that begins lower may lead upwards.
        let lowest_m = self.least_m().min(from_m - TOLERANCE_M);
        let points = (detour.duration_s() / DETOUR_STEP_S).clamp(1.0, MOST_DETOUR_POINTS) as u32;
        for index in 0..=points {
            let t_s = detour.duration_s() * f64::from(index) / f64::from(points);
            let position = detour.sample(t_s).position;
            // Comparisons with NaN are false.
            let (is_inside, is_high) =
                (self.fence.inside_soft_m(&position) > 0.0, position.z >= lowest_m);
            match (is_inside, is_high) {
                (true, true) => {}
                (false, _) => return Err(Cause::Fence),
                (_, false) => return Err(Cause::NearFloor),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector4;

    fn moving(rate: Vector4<f64>) -> ReferenceMotion {
        let value = Vector4::new(0.0, 0.0, 1.0, 0.0);
        ReferenceMotion { value, rate, acceleration: Vector4::zeros() }
    }

    #[test]
    fn a_stop_brakes_harder_only_if_the_room_requires_it() {
        let room = StoppingRoom::new(&Config::default());
        let slow = moving(Vector4::new(0.0, 0.0, -0.1, 0.0));
        assert_eq!(room.stop(&slow), Leg::stop(&slow, room.legs()));
        let fast = moving(Vector4::new(0.0, 0.0, -1.2, 0.0));
        let stop = room.stop(&fast);
        assert!(stop.duration_s() < Leg::stop(&fast, room.legs()).duration_s());
    }

    #[test]
    fn the_search_for_a_stop_ends_for_a_motion_that_is_not_finite() {
        let room = StoppingRoom::new(&Config::default());
        for rate in [f64::NAN, f64::INFINITY] {
            room.stop(&moving(Vector4::new(rate, 0.0, 0.0, 0.0)));
        }
    }
}
