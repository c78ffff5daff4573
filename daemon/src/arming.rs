//! Checks before arming. Every obstacle is reported, not only the first.

use std::sync::Arc;

use nalgebra::Vector3;
use oqtal_bus::code::{ControlHolder, EstimatorState, VehicleRefusal};
use oqtal_bus::message::VehicleV1;
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::predictive::MeasuredPose;
use oqtal_control::trajectory::Trajectory;

use crate::fence::Fence;
use crate::flight_room::Way;
use crate::guard::AcceptedPose;
use crate::limits::FlightLimits;

/// Poses by which the vehicle is at rest or not \[-\].
const REST_POSES: usize = 30;
/// Least time between two recent poses, so that those of fast cameras span as much time as those of slow ones.
const REST_SPACING: Span = Span::from_millis(13);
/// Share of them that must be where the last one is \[-\]: the others may be outliers.
const REST_SHARE: f64 = 0.6;
/// Distance within which a vehicle is at rest \[m\].
const REST_M: f64 = 0.015;
/// Angle within which it is \[rad\].
const REST_RAD: f64 = 0.05;

/// The state of the daemon that arming depends on.
#[derive(Clone, Copy, Debug)]
pub struct ArmingView<'a> {
    /// Whether enough good poses arrived in a row.
    pub poses_good: bool,
    /// The last accepted pose.
    pub last: Option<&'a AcceptedPose>,
    /// The last message about the vehicle, if it answers.
    pub vehicle: Option<&'a VehicleV1>,
    /// Whether processes run with different configurations.
    pub configs_differ: bool,
}

/// Path of a flight along a trajectory, relative to its start.
#[derive(Clone, Debug)]
pub(crate) struct ArmingPath {
    /// Points of the trajectory \[m\].
    points: Arc<[Vector3<f64>]>,
    /// Points at which the vehicle comes to rest if it brakes at each of `points` \[m\].
    stops: Arc<[Vector3<f64>]>,
}

impl ArmingPath {
    /// The path of `trajectory`.
    pub(crate) fn new(config: &Config, trajectory: &Trajectory) -> Self {
        let [points, stops] = Way::both(config, trajectory, Vector3::zeros());
        Self { points: points.thinned().collect(), stops: stops.thinned().collect() }
    }
}

/// Whether a real vehicle reports running motors although no flight commands it, for example after its bridge was killed in flight.
fn runs_uncommanded(vehicle: &VehicleV1) -> bool {
    let is_held = vehicle.control == ControlHolder::Another.code();
    vehicle.simulated == 0 && vehicle.armed != 0 && !vehicle.is_being_stopped() && !is_held
}

/// The check before a flight.
#[derive(Clone, Debug)]
pub struct ArmingCheck {
    limits: FlightLimits,
    heights: [f64; 2],
    /// Cosine of the greatest tilt \[-\].
    least_upright: f64,
    allows_emulated: bool,
    /// Greatest time-out of a real vehicle \[s\]; infinite: also none.
    time_out_s: f64,
    path: ArmingPath,
    recent: [Option<MeasuredPose>; REST_POSES],
    next: usize,
    /// Instant of the newest of them.
    newest_at: Time,
    /// Poses without which nothing is known of the vehicle's rest \[-\].
    least_poses: usize,
}

impl ArmingCheck {
    /// The check before flights of `trajectory`.
    pub fn new(config: &Config, trajectory: &Trajectory) -> Self {
        let safety = &config.safety;
        Self {
            limits: FlightLimits::new(config),
            heights: safety.arming_z_m,
            least_upright: safety.arming_tilt_deg.to_radians().cos(),
            allows_emulated: safety.allow_emulated_poses,
            time_out_s: safety.vehicle_time_out_ms * 1e-3,
            path: ArmingPath::new(config, trajectory),
            recent: [None; REST_POSES],
            next: 0,
            newest_at: Time::UNSET,
            least_poses: REST_POSES.min(safety.recovery_poses as usize),
        }
    }

    /// Exchanges the path of the next flight.
    pub(crate) fn exchange_path(&mut self, path: &mut ArmingPath) {
        std::mem::swap(&mut self.path, path);
    }

    /// Takes an accepted pose, in flight too: a vehicle that has just flown is not at rest.
    pub fn take(&mut self, accepted: &AcceptedPose) {
        if accepted.captured_at < self.newest_at + REST_SPACING {
            return;
        }
        self.newest_at = accepted.captured_at;
        self.recent[self.next] = Some(accepted.pose);
        self.next = (self.next + 1) % REST_POSES;
    }

    /// Discards the recent poses; a full new set is needed afterwards. A vehicle stopped in a hover falls, although its last poses are at
    /// rest.
    pub fn forget_rest(&mut self) {
        (self.recent, self.least_poses) = ([None; REST_POSES], REST_POSES);
    }

    /// Everything that keeps a flight from beginning.
    pub fn obstacles(&self, view: &ArmingView) -> ArmingObstacles {
        use ArmingObstacle as O;
        let real = view.vehicle.is_some_and(|vehicle| vehicle.simulated == 0);
        // Single precision on the wire of an autopilot.
        let is_soon = |after_s: f64| after_s > 0.0 && after_s <= self.time_out_s * (1.0 + 1e-6);
        let acts = self.time_out_s.is_infinite()
            || view.vehicle.is_none_or(|vehicle| is_soon(vehicle.time_out_s));
        let low = view.vehicle.is_some_and(|vehicle| self.limits.is_battery_low(vehicle));
        let has_code = |code: fn(&VehicleV1) -> u8, value| {
            view.vehicle.is_some_and(|vehicle| code(vehicle) == value)
        };
        let taken = has_code(|vehicle| vehicle.control, ControlHolder::Another.code());
        let refuses = |refusal: VehicleRefusal| has_code(|vehicle| vehicle.refusal, refusal.code());
        let is_set_up = !refuses(VehicleRefusal::NotSetUp);
        let lost = has_code(|vehicle| vehicle.estimator, EstimatorState::NotReady.code());
        let general = ArmingObstacles::default()
            .with(O::ControlTaken, taken)
            .with(O::EstimatorNotReady, lost)
            .with(O::NoTimeOut, real && !acts && is_set_up)
            .with(O::NotSetUp, !is_set_up)
            .with(O::MotorsStopping, view.vehicle.is_some_and(VehicleV1::is_being_stopped))
            .with(O::MotorsRunning, view.vehicle.is_some_and(runs_uncommanded))
            .with(O::Locked, refuses(VehicleRefusal::Locked))
            .with(O::NoPoses, !view.poses_good || view.last.is_none())
            .with(O::VehicleSilent, view.vehicle.is_none())
            .with(O::BatteryLow, low)
            .with(O::Configuration, view.configs_differ)
            .with(O::Stopped, view.vehicle.is_some_and(|vehicle| vehicle.stopped != 0));
        // An old pose says nothing about where the vehicle is now.
        let Some(last) = view.last.filter(|_| view.poses_good) else { return general };
        let upright = last.pose.attitude.to_world(&Vector3::z()).z;
        let [low, high] = self.heights;
        let inside = self.fence().inside_soft_m(&last.pose.position) > 0.0;
        general
            .with(O::Moving, !self.is_at_rest(&last.pose))
            .with(O::Tilted, upright < self.least_upright)
            .with(O::OffFloor, !(low..=high).contains(&last.pose.position.z))
            .with(O::EmulatedPoses, last.simulated && real && !self.allows_emulated)
            .with(O::OutsideFence, !inside)
            .with(O::PathOutsideFence, inside && self.leaves_fence(&last.pose.position))
    }

    /// The fence.
    pub fn fence(&self) -> &Fence {
        &self.limits.fence
    }

    /// Whether most of the recent poses agree with `last`.
    fn is_at_rest(&self, last: &MeasuredPose) -> bool {
        let same = |pose: &&MeasuredPose| {
            (pose.position - last.position).norm() <= REST_M
                && pose.attitude.angle_to(&last.attitude) <= REST_RAD
        };
        let known = self.recent.iter().flatten().count();
        let alike = self.recent.iter().flatten().filter(same).count();
        known >= self.least_poses && alike as f64 >= REST_SHARE * known as f64
    }

    fn leaves_fence(&self, start: &Vector3<f64>) -> bool {
        let is_inside = |point| self.fence().inside_soft_m(&(start + point)) > 0.0;
        let stops_inside = |point| self.fence().inside_m(&(start + point)) > 0.0;
        let ArmingPath { points, stops } = &self.path;
        !(points.iter().all(is_inside) && stops.iter().all(stops_inside))
    }
}
