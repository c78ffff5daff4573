//! The limits of a flight: from the motion, the reference, the vehicle and the poses to the conditions of the supervisor's table.

use nalgebra::Vector3;
use oqtal_bus::message::VehicleV1;
use oqtal_config::Config;
use oqtal_control::predictive::{Motion, Track};
use oqtal_control::trajectory::Reference;

use crate::fence::{Braking, Fence};
use crate::floor::OFF_FLOOR_M;

/// Standard deviations of the predicted position by which the border of the fence is kept \[-\].
const FENCE_SIGMA: f64 = 3.0;
/// The same for a descent without poses. Level, and with less thrust than in a hover, the vehicle moves less than the uncertainty of a
/// general flight allows; stopping the motors would let it fall.
const DESCENT_SIGMA: f64 = 0.5;
/// Fraction of maximum thrust, as commanded, above which thrust counts as full \[-\].
const FULL_THRUST: f64 = 0.95;
/// Distance below the reference \[m\] and speed downward \[m/s\] at which a vehicle under full thrust sinks.
const SINKS_M: f64 = 0.2;
const SINKS_M_S: f64 = 0.1;
/// Least cosine of the tilt in the horizontal acceleration of a vehicle that keeps its height \[-\].
const LEAST_COSINE: f64 = 0.5;

/// Whether each limit is exceeded in this tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LimitConditions {
    /// The vehicle would cross the hard border of the fence before a Stop takes effect.
    pub leaves_fence: bool,
    /// The vehicle is outside the soft border, or is too fast to stop before the hard one.
    pub in_fence_margin: bool,
    /// The fence held the flight for longer than a flight may be held.
    pub held_too_long: bool,
    /// The vehicle is faster than `safety.speed-limit-m-s`.
    pub too_fast: bool,
    /// The vehicle is tilted by more than `safety.tilt-warning-deg`.
    pub tilted: bool,
    /// The vehicle is tilted by more than `safety.tilt-limit-deg`.
    pub tipped: bool,
    /// The vehicle is further from its reference than `safety.tracking-limit-m`.
    pub far_off: bool,
    /// The vehicle sinks away from its reference under full thrust.
    pub sinks: bool,
    /// The vehicle is on the floor although its thrust must have lifted it.
    pub stays_on_floor: bool,
    /// The vehicle is on the floor with thrust while its reference is above.
    pub lies_on_floor: bool,
    /// The landing should have ended.
    pub landing_overdue: bool,
    /// The battery voltage is below `safety.battery-low-v`.
    pub battery_low: bool,
    /// The battery voltage is below `safety.battery-empty-v`.
    pub battery_empty: bool,
    /// Fewer requests are answered than `safety.link-poor`.
    pub link_poor: bool,
    /// Fewer requests are answered than `safety.link-bad`.
    pub link_bad: bool,
    /// Poses are older than `safety.pose-age-warning-ms`.
    pub poses_old: bool,
    /// Poses are older than `safety.pose-age-limit-ms`.
    pub poses_too_old: bool,
    /// More frames are lost or refused than `safety.pose-loss-warning`.
    pub poses_lost: bool,
    /// Poses do not follow the rotation that the vehicle's gyroscope measures.
    pub poses_contradict: bool,
    /// A weaker test finds that poses disagree with the vehicle.
    pub poses_disagree: bool,
    /// Poses disagree with the vehicle while it is far from its reference or too fast: the law may be following wrong poses.
    pub poses_mislead: bool,
    /// The loop was late in several ticks in a row.
    pub overrun: bool,
    /// The loop made no tick for longer than `safety.coast-ms`.
    pub stood_still: bool,
    /// Processes of the instance run with different configurations.
    pub configs_differ: bool,
    /// Files of the instance were removed.
    pub files_lost: bool,
    /// The reference is invalid.
    pub setpoint_refused: bool,
    /// The fallback law flies: the configured law failed.
    pub law_fails: bool,
    /// The vehicle holds its position because a planner's references ended.
    pub references_ended: bool,
    /// The vehicle has held its position for this reason for longer than `reference.land-after-ms`.
    pub references_overdue: bool,
}

/// A flight in one tick.
#[derive(Clone, Copy, Debug)]
pub struct FlightView<'a> {
    /// The motion at the instant at which a command sent now takes effect.
    pub motion: &'a Track,
    /// Height of the floor \[m, world z\].
    pub floor_m: f64,
    /// The reference.
    pub reference: &'a Reference,
    /// The thrust of the last command \[N\].
    pub thrust_n: f64,
    /// Whether the vehicle descends without poses.
    pub is_descent: bool,
}

/// The thresholds of the limits.
#[derive(Clone, Debug)]
pub struct FlightLimits {
    /// The fence.
    pub fence: Fence,
    motion: LoopLimits,
    /// Gravity \[m/s^2\], and drag \[1/s\].
    gravity: f64,
    drag: f64,
    speed: f64,
    /// Cosines of the tilts \[-\].
    warning_upright: f64,
    least_upright: f64,
    tracking: f64,
    battery_low: f64,
    battery_empty: f64,
    link_poor: f64,
    link_bad: f64,
}

/// Limits of the motion that follow from those of the position loops, which may change in flight.
#[derive(Clone, Copy, Debug)]
pub struct LoopLimits {
    /// Braking of a vehicle that stops at the fence.
    braking: Braking,
    /// Greatest thrust that the loops command \[N\].
    greatest_lift: f64,
}

impl LoopLimits {
    /// The limits of `config`.
    pub fn of(config: &Config) -> Self {
        let vehicle = &config.vehicle;
        let lift = vehicle.gravity_m_s2 + config.position.vertical_acceleration_limit_m_s2;
        Self {
            braking: Braking::of(config),
            greatest_lift: (vehicle.mass_kg * lift).min(vehicle.max_thrust_n),
        }
    }
}

impl FlightLimits {
    /// The limits of `config`.
    pub fn new(config: &Config) -> Self {
        let safety = &config.safety;
        Self {
            fence: Fence::new(&config.fence),
            motion: LoopLimits::of(config),
            gravity: config.vehicle.gravity_m_s2,
            drag: config.vehicle.drag_per_s,
            speed: safety.speed_limit_m_s,
            warning_upright: safety.tilt_warning_deg.to_radians().cos(),
            least_upright: safety.tilt_limit_deg.to_radians().cos(),
            tracking: safety.tracking_limit_m,
            battery_low: safety.battery_low_v,
            battery_empty: safety.battery_empty_v,
            link_poor: safety.link_poor,
            link_bad: safety.link_bad,
        }
    }

    /// Replaces the limits of the motion.
    pub fn set_motion(&mut self, motion: LoopLimits) {
        self.motion = motion;
    }

    /// Fills in the conditions of the flight.
    pub fn check(&self, flight: &FlightView, conditions: &mut LimitConditions) {
        let FlightView { motion: Track { motion, .. }, floor_m, reference, thrust_n, is_descent } =
            *flight;
        let upright = motion.attitude.to_world(&Vector3::z()).z;
        let sigma = if is_descent { DESCENT_SIGMA } else { FENCE_SIGMA };
        let margin = sigma * flight.motion.position_sd_m();
        let inside = self.fence.inside_by_m(&motion.position, margin);
        let (is_inside, is_upright) = (|by_m: f64| by_m > 0.0, |cosine: f64| upright >= cosine);
        let is_within = |distance: f64, limit: f64| distance <= limit;
        // Comparisons with NaN are false: a motion that is not finite is outside and tipped.
        conditions.leaves_fence = !is_inside(inside);
        let stop = self.stopping_point(motion);
        conditions.in_fence_margin = !is_inside(self.fence.inside_soft_m(&motion.position))
            || !is_inside(self.fence.inside_m(&stop));
        conditions.too_fast = !is_within(motion.velocity.norm(), self.speed);
        conditions.tilted = !is_upright(self.warning_upright);
        conditions.tipped = !is_upright(self.least_upright);
        let off = motion.position - reference.position;
        conditions.far_off = reference.attitude.is_none() && !is_within(off.norm(), self.tracking);
        let sinks = off.z < -SINKS_M && motion.velocity.z < -SINKS_M_S;
        conditions.sinks = sinks && thrust_n * upright >= FULL_THRUST * self.motion.greatest_lift;
        let is_on_floor = flight.motion.is_at_floor(floor_m);
        let is_above = reference.position.z > floor_m + OFF_FLOOR_M;
        conditions.lies_on_floor = is_on_floor && is_above && thrust_n > 0.0;
    }

    /// The point at which a vehicle in `motion` stops \[m, world\]. A tilted vehicle accelerates until it has turned,
    /// as far as the tilt does more than to balance the drag.
    fn stopping_point(&self, motion: &Motion) -> Vector3<f64> {
        let up = motion.attitude.to_world(&Vector3::z());
        let acceleration =
            up.xy() * (self.gravity / up.z.max(LEAST_COSINE)) - motion.velocity.xy() * self.drag;
        self.motion.braking.stopping_point(&motion.position, &motion.velocity, &acceleration)
    }

    /// Fills in the conditions of the vehicle; an unknown number exceeds no limit.
    pub fn check_vehicle(&self, vehicle: &VehicleV1, conditions: &mut LimitConditions) {
        conditions.battery_low = self.is_battery_low(vehicle);
        conditions.battery_empty = vehicle.battery_v < self.battery_empty;
        conditions.link_poor = vehicle.link_quality < self.link_poor;
        conditions.link_bad = vehicle.link_quality < self.link_bad;
    }

    /// Whether the battery voltage is known and low.
    pub fn is_battery_low(&self, vehicle: &VehicleV1) -> bool {
        vehicle.battery_v < self.battery_low
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_control::predictive::{MeasuredPose, TrackNoise};
    use oqtal_control::quaternion::Attitude;
    use oqtal_control::trajectory::Phase;

    /// Conditions of a vehicle at the height `z_m` with this climb velocity, tilt about x and share of the greatest lift, whose
    /// reference is at `reference_m`.
    fn conditions(
        z_m: f64,
        speed_m_s: f64,
        tilt_rad: f64,
        (share, reference_m): (f64, f64),
    ) -> LimitConditions {
        let config = Config::default();
        let limits = FlightLimits::new(&config);
        let pose = MeasuredPose {
            position: Vector3::z() * z_m,
            attitude: Attitude::from_rotation_vector(Vector3::x() * tilt_rad),
        };
        let noise = TrackNoise { admission: config.control.predictive.filter, estimation: None };
        let mut motion = Track::at_rest(&noise, 0.0, &pose);
        motion.motion.velocity.z = speed_m_s;
        let mut conditions = LimitConditions::default();
        let flight = FlightView {
            motion: &motion,
            floor_m: 0.0,
            reference: &Reference::rest(Vector3::z() * reference_m, Phase::Trajectory),
            thrust_n: share * limits.motion.greatest_lift,
            is_descent: false,
        };
        limits.check(&flight, &mut conditions);
        conditions
    }

    /// Whether a vehicle `below_m` below its reference sinks, with this vertical speed, share of the greatest lift and tilt.
    fn sinks(below_m: f64, speed_m_s: f64, share: f64, tilt_rad: f64) -> bool {
        conditions(2.0, speed_m_s, tilt_rad, (share, 2.0 + below_m)).sinks
    }

    #[test]
    fn f39_a_vehicle_lies_on_the_floor_with_thrust_below_a_reference_in_the_air() {
        let lies =
            |z_m, share, reference_m| conditions(z_m, 0.0, 0.0, (share, reference_m)).lies_on_floor;
        assert!(lies(0.0, 0.1, 1.0));
        assert!(!lies(0.0, 0.0, 1.0) && !lies(0.0, 0.1, 0.2) && !lies(0.5, 0.1, 1.0));
    }

    #[test]
    fn a_link_and_a_voltage_at_a_limit_are_not_below_it() {
        let limits = FlightLimits::new(&Config::default());
        let of = |vehicle: VehicleV1| {
            let mut conditions = LimitConditions::default();
            limits.check_vehicle(&vehicle, &mut conditions);
            conditions
        };
        let of_link = |link_quality: f64| {
            let conditions = of(VehicleV1 { link_quality, ..VehicleV1::default() });
            [conditions.link_poor, conditions.link_bad]
        };
        assert_eq!(of_link(limits.link_poor), [false, false]);
        assert_eq!(of_link(limits.link_bad), [true, false]);
        let at = |battery_v: f64| {
            let conditions = of(VehicleV1 { battery_v, ..VehicleV1::default() });
            [conditions.battery_low, conditions.battery_empty]
        };
        assert_eq!(at(limits.battery_low), [false, false]);
        assert_eq!(at(limits.battery_empty), [true, false]);
        assert_eq!(at(limits.battery_empty - 0.1), [true, true]);
        assert_eq!(at(f64::NAN), [false, false]);
    }

    #[test]
    fn f42_a_vehicle_sinks_below_its_reference_downward_under_full_upright_thrust() {
        assert!(sinks(0.21, -0.11, 0.96, 0.0));
        // Above or near its reference, not downward, not under full thrust, not upright.
        let others = [
            sinks(0.19, -0.11, 0.96, 0.0),
            sinks(-0.21, -0.11, 0.96, 0.0),
            sinks(0.21, -0.09, 0.96, 0.0),
            sinks(0.21, 0.11, 0.96, 0.0),
            sinks(0.21, -0.11, 0.94, 0.0),
            sinks(0.21, -0.11, 0.96, 0.3),
        ];
        assert_eq!(others, [false; 6]);
    }
}
