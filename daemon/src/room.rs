//! The room of a flight under way: the soft border of the fence and the floor, and the stops that stay inside.

use nalgebra::Vector3;
use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::trajectory::{Detour, Leg, LegLimits, ReferenceMotion};

use crate::fence::{Braking, Fence};
use crate::floor::LEAST_WAY_M;

/// Time between two points of a detour that are compared with the room \[s\], and most points \[-\].
const DETOUR_STEP_S: f64 = 0.1;
const MOST_DETOUR_POINTS: f64 = 1000.0;
/// Points of a stop that are compared with the room \[-\].
const STOP_POINTS: u32 = 16;
/// Factor from one acceleration of a stop to the next one that is tried \[-\].
const HARDER: f64 = 1.25;
/// Height by which a way that begins near the floor may go below its beginning \[m\].
const TOLERANCE_M: f64 = 1e-6;

/// The room of a flight. No method allocates.
#[derive(Clone, Debug)]
pub struct Room {
    fence: Fence,
    legs: LegLimits,
    braking: Braking,
    /// Height of the floor on which the flight began \[m, world z\].
    floor_m: f64,
}

impl Room {
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
        self.fence.inside_soft_m(position) > 0.0 && position.z >= self.floor_m + LEAST_WAY_M
    }

    /// The stop from the motion `from`: with the acceleration of `[reference]` if that has room, otherwise as hard as the room
    /// requires, and at most as hard as the vehicle brakes.
    pub fn stop(&self, from: &ReferenceMotion) -> Leg {
        let hardest = self.hardest_m_s2(from);
        let mut acceleration_m_s2 = self.legs.acceleration_m_s2;
        loop {
            let leg = Leg::stop(from, &LegLimits { acceleration_m_s2, ..self.legs });
            if acceleration_m_s2 >= hardest || self.has_room(&leg) {
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

    /// Whether a vehicle that follows the stop `leg`, and reacts late, stays inside.
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
        let lowest_m = (self.floor_m + LEAST_WAY_M).min(from_m - TOLERANCE_M);
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
