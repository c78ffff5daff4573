//! The course of a flight: its mission, and the reference that is flown in a tick.

mod attitude;

use nalgebra::{Vector3, Vector4};
use oqtal_bus::code::{Cause, SafetyState};
use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::estimator::Estimate;
use oqtal_control::euler::EulerAngles;
use oqtal_control::trajectory::{
    Detour, FlightPlan, Leg, LegLimits, Phase, Reference, ReferenceMotion, StartPoint, Trajectory,
    TrajectoryOptions,
};

use crate::condition::Followed;
use crate::fence::Fence;
use crate::floor;
use crate::live::{FlightChange, LiveControl, leg_limits};
use crate::mission::ActiveMission;
use crate::setpoint::{CheckedSetpoint, SetpointGuard};
use crate::stream::ReferenceStream;

/// Speed below which a vehicle is at rest \[m/s\].
const REST_M_S: f64 = 0.1;
/// Time for which a vehicle that landed must be at rest.
const REST: Span = Span::from_millis(500);
/// Time between two points of a detour that are compared with the fence and the floor \[s\], and most points \[-\].
const DETOUR_STEP_S: f64 = 0.1;
const MOST_DETOUR_POINTS: f64 = 1000.0;
/// Height by which a way that begins near the floor may go below its beginning \[m\].
const TOLERANCE_M: f64 = 1e-6;

/// Course of a flight.
#[derive(Clone, Debug)]
pub(super) struct FlightCourse {
    observe_only: bool,
    weight_n: f64,
    trajectory: Trajectory,
    options: TrajectoryOptions,
    legs: LegLimits,
    fence: Fence,
    stream: ReferenceStream,
    check: SetpointGuard,
    /// The last estimate of position \[m, world\] and velocity \[m/s, world\].
    vehicle: [Vector3<f64>; 2],
    mission: Option<ActiveMission>,
    /// The reference of this tick: it is flown, and the limits of the flight are relative to it.
    setpoint: CheckedSetpoint,
    /// The last position inside the soft border of the fence \[m, world\].
    inside: Option<Vector3<f64>>,
    /// The instant since which the vehicle, which lands, is at rest.
    at_rest_since: Option<Time>,
    /// Whether the vehicle descends without poses.
    is_descent: bool,
}

impl FlightCourse {
    /// The course of flights of `trajectory` inside `fence`.
    pub(super) fn new(config: &Config, trajectory: Trajectory, fence: Fence) -> Self {
        Self {
            observe_only: config.safety.observe_only,
            weight_n: config.vehicle.mass_kg * config.vehicle.gravity_m_s2,
            options: config.trajectory.clone(),
            legs: leg_limits(config),
            stream: ReferenceStream::new(config, fence.clone()),
            check: SetpointGuard::new(fence.clone()),
            fence,
            vehicle: [Vector3::zeros(); 2],
            mission: None,
            setpoint: CheckedSetpoint::default(),
            inside: None,
            at_rest_since: None,
            is_descent: false,
            trajectory,
        }
    }

    /// The mission; `None` on the ground.
    pub(super) fn mission(&self) -> Option<&ActiveMission> {
        self.mission.as_ref()
    }

    /// The reference of this tick.
    pub(super) fn setpoint(&self) -> &CheckedSetpoint {
        &self.setpoint
    }

    /// The reference of the plan, or of a planner, at `at`; `None` without one, and while the reference is refused.
    pub(super) fn reference_at(&self, at: Time) -> Option<Reference> {
        let mission = self.mission.as_ref().filter(|_| self.setpoint.refusal.is_none())?;
        let streamed = self.stream.reference(at).filter(|_| !mission.is_held());
        Some(streamed.unwrap_or_else(|| mission.reference(at)))
    }

    /// Source of the references.
    pub(super) fn followed(&self, now: Time) -> Followed {
        match &self.mission {
            Some(_) if self.stream.is_followed() => Followed::Planner,
            Some(mission) if mission.has_arrived(now) => Followed::End,
            _ => Followed::Course,
        }
    }

    /// Records a position inside the soft border of the fence \[m, world\].
    pub(super) fn record_inside(&mut self, position: Vector3<f64>) {
        self.inside = Some(position);
    }

    /// Begins a flight of a vehicle at `estimate`.
    pub(super) fn begin_flight(&mut self, now: Time, estimate: &Estimate) {
        let start = StartPoint {
            position: estimate.position,
            yaw_rad: EulerAngles::from_attitude(&estimate.attitude).yaw,
        };
        let plan = FlightPlan::new(&self.options, self.trajectory.clone(), start);
        self.check.reset();
        self.stream.reset();
        (self.inside, self.at_rest_since, self.is_descent) = (None, None, false);
        self.mission = Some(ActiveMission::fly(plan, estimate.position.z, now));
        self.update_setpoint(now);
    }

    /// Begins the observation of a vehicle at `position` \[m, world\].
    pub(super) fn begin_observation(&mut self, now: Time, position: Vector3<f64>) {
        self.mission = Some(ActiveMission::observe(position, now));
        self.update_setpoint(now);
    }

    /// Ends the flight.
    pub(super) fn end(&mut self) {
        self.mission = None;
        self.setpoint = CheckedSetpoint::default();
    }

    /// Checks the reference at `now`: once in a tick, and again where the plan has changed in it.
    pub(super) fn update_setpoint(&mut self, now: Time) {
        self.expire_stream(now);
        let Some(mission) = &self.mission else { return };
        let streamed = self.stream.reference(now).filter(|_| !mission.is_held());
        let reference = streamed.unwrap_or_else(|| mission.reference(now));
        self.setpoint = match self.observe_only {
            true => CheckedSetpoint { reference: Some(reference), refusal: None },
            false => self.check.pass(mission.changes(), &reference),
        };
        self.setpoint.refusal = self.stream.take_refusal().or(self.setpoint.refusal);
    }

    /// The motion of the reference at `now`; `None` on the ground. Of a planner's attitude it is the motion of the vehicle.
    fn motion(&self, now: Time) -> Option<ReferenceMotion> {
        let mission = self.mission.as_ref()?;
        let Some(mut motion) = self.stream.motion(now) else { return Some(mission.motion(now)) };
        if self.stream.prescribes_attitude() {
            let [position, velocity] = self.vehicle;
            motion.value = position.xy().push(motion.value.z).push(motion.value.w);
            motion.rate = velocity.xy().push(0.0).push(0.0);
            motion.acceleration = Vector4::zeros();
        }
        Some(motion)
    }

    /// Brings the vehicle to rest where a planner's references ended.
    fn expire_stream(&mut self, now: Time) {
        let Some(motion) = self.motion(now).filter(|_| self.stream.expire(now)) else { return };
        self.stop_from(now, &motion);
    }

    fn stop_from(&mut self, now: Time, motion: &ReferenceMotion) {
        if let Some(mission) = &mut self.mission {
            mission.redirect(now, Detour::stay(Leg::stop(motion, &self.legs)));
        }
    }

    /// Ends a planner's stream; without another command the vehicle comes to rest.
    fn end_stream(&mut self, now: Time) {
        if let Some(motion) = self.motion(now).filter(|_| self.stream.is_followed()) {
            self.stop_from(now, &motion);
        }
        self.stream.end();
    }

    /// Whether the vehicle holds its position because a planner's references ended, and whether it has for so long that it must
    /// land.
    pub(super) fn stream_ended(&self, now: Time) -> [bool; 2] {
        self.stream.ended(now)
    }

    /// Whether the flight can be changed: it is not in its take-off or landing.
    fn require_changeable(&self) -> Result<(), Cause> {
        match self.setpoint.reference.map(|reference| reference.phase) {
            Some(Phase::Settle | Phase::Trajectory) => Ok(()),
            Some(Phase::TakeOff) => Err(Cause::TakeOff),
            Some(Phase::Landing) | None => Err(Cause::WrongMode),
        }
    }

    /// Takes a reference of the planner `source`, over the floor at `floor_m` \[m\]; without effect during take-off and landing.
    pub(super) fn receive_reference(
        &mut self,
        now: Time,
        (source, message): (u64, &ReferenceV1),
        floor_m: f64,
    ) {
        if self.require_changeable().is_err() {
            return;
        }
        let Some(present) = self.motion(now) else { return };
        let was_followed = self.stream.is_followed();
        self.stream.receive(now, (source, message), (&present, floor_m));
        if self.stream.is_followed() && !was_followed {
            // The plan is not resumed after the stream.
            self.stop_from(now, &present);
        }
    }

    /// Changes the flight from the present motion of the reference on.
    ///
    /// # Errors
    /// The flight takes off or lands, or its path would leave the soft border of the fence or come close to the floor.
    pub(super) fn change(&mut self, now: Time, change: &FlightChange) -> Result<(), Cause> {
        self.require_changeable()?;
        let (Some(motion), Some(mission)) = (self.motion(now), &self.mission) else {
            return Err(Cause::WrongMode);
        };
        let detour = match change {
            FlightChange::Goto(target) => {
                let yaw = if target.w.is_nan() { motion.value.w } else { target.w };
                let target = target.xyz().push(yaw);
                Detour::stay(Leg::to(&motion, &target, &self.legs))
            }
            FlightChange::Trajectory(trajectory) => {
                let trajectory = Trajectory::clone(trajectory);
                Detour::fly(trajectory, &motion, &mission.origin(), &self.legs)
            }
            FlightChange::Hover => Detour::stay(Leg::stop(&motion, &self.legs)),
            FlightChange::Settings(_) => return Ok(()),
        };
        // The reference of the stop after a fast motion is what it is.
        let is_hover = matches!(change, FlightChange::Hover);
        if !is_hover {
            self.require_room(&detour, (mission.origin().z, motion.value.z))?;
        }
        self.stream.end();
        if let Some(mission) = &mut self.mission {
            mission.redirect(now, detour);
        }
        self.update_setpoint(now);
        Ok(())
    }

    /// Requires that `detour`, which begins at the height `from_m`, stays inside the soft border of the fence and above the floor at
    /// `floor_m` \[m, world z\].
    fn require_room(&self, detour: &Detour, (floor_m, from_m): (f64, f64)) -> Result<(), Cause> {
        // A way that begins lower may lead upwards.
        let lowest_m = (floor_m + floor::LEAST_WAY_M).min(from_m - TOLERANCE_M);
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

    /// Exchanges the options of later flights and changes with those of `live`; the flight under way is not changed.
    pub(super) fn exchange(&mut self, live: &mut LiveControl) {
        std::mem::swap(&mut self.trajectory, &mut live.trajectory);
        std::mem::swap(&mut self.options, &mut live.options);
        self.legs = live.legs;
        self.stream.set_limits(&live.stream);
    }

    /// Holds the vehicle, which is at `position` \[m, world\], lands or waits for the end of a descent if the safety state demands it,
    /// and resumes the mission if it no longer does. `is_landing` if the vehicle lands already; returns whether it does now.
    pub(super) fn follow(
        &mut self,
        now: Time,
        state: SafetyState,
        position: Vector3<f64>,
        is_landing: bool,
    ) -> bool {
        if state >= SafetyState::Hold {
            self.end_stream(now);
        }
        let Some(mission) = self.mission.as_mut().filter(|_| !self.observe_only) else {
            return is_landing;
        };
        let changes = mission.changes();
        let mut lands = is_landing;
        match state {
            // Poses have come back.
            SafetyState::Land if self.is_descent => {
                mission.land_from(now, self.setpoint.at(position).into());
                self.is_descent = false;
            }
            SafetyState::Land if !is_landing => {
                self.land(now, position);
                lands = true;
            }
            SafetyState::Hold if !is_landing => {
                mission.hold(now, self.setpoint.at(self.inside.unwrap_or(position)));
            }
            SafetyState::Descend => {
                mission.hold(now, self.setpoint.at(position));
                (self.is_descent, lands) = (true, true);
            }
            // Blindness interrupts neither.
            SafetyState::Nominal | SafetyState::Degraded => mission.resume(now),
            _ => {}
        }
        if self.mission.as_ref().map(ActiveMission::changes) != Some(changes) {
            self.update_setpoint(now);
        }
        lands
    }

    /// Lands above `position` \[m, world\], from the height and at the heading of the reference that was flown last.
    pub(super) fn land(&mut self, now: Time, position: Vector3<f64>) {
        let height = self.setpoint.reference.map_or(position.z, |last| last.position.z);
        self.end_stream(now);
        if let Some(mission) = &mut self.mission {
            let point = self.setpoint.at(position.xy().push(height));
            mission.land_from(now, point.into());
        }
    }

    /// Keeps the mission at its beginning.
    pub(super) fn restart(&mut self, now: Time) {
        if let Some(mission) = &mut self.mission {
            mission.restart(now);
        }
        self.update_setpoint(now);
    }

    /// Whether the reference is in its landing.
    pub(super) fn is_landing(&self) -> bool {
        self.setpoint.reference.is_some_and(|reference| reference.phase == Phase::Landing)
    }

    /// Whether a vehicle at `estimate` under the thrust `thrust_n` \[N\] has landed: at the floor from which it took off, or at rest for a
    /// while, wherever it is, under a thrust that cannot hold it in the air.
    pub(super) fn has_landed(&mut self, now: Time, estimate: &Estimate, thrust_n: f64) -> bool {
        let (Some(mission), Some(reference)) = (&self.mission, &self.setpoint.reference) else {
            return false;
        };
        mission.has_landed(reference, estimate)
            || self.is_at_rest_on_ground(now, estimate, thrust_n)
    }

    fn is_at_rest_on_ground(&mut self, now: Time, estimate: &Estimate, thrust_n: f64) -> bool {
        let is_at_rest = self.is_landing()
            && thrust_n < floor::STANDING * self.weight_n
            && estimate.velocity.norm() < REST_M_S;
        if !is_at_rest {
            self.at_rest_since = None;
            return false;
        }
        now.since(*self.at_rest_since.get_or_insert(now)) >= REST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn f41_a_vehicle_has_landed_once_it_rests_for_half_a_second_without_a_break() {
        let config = Config::default();
        let trajectory = crate::trajectory(&config).unwrap();
        let mut course = FlightCourse::new(&config, trajectory, Fence::new(&config.fence));
        let start = Time::VIRTUAL_START;
        let (raised, rising) = (Vector3::z(), Vector3::z() * 0.2);
        let at_rest = Estimate { position: raised, ..Estimate::default() };
        let moving = Estimate { velocity: rising, ..at_rest };
        course.begin_flight(start, &Estimate::default());
        course.land(start, raised);
        course.update_setpoint(start + Span::from_millis(100));
        let weight_n = config.vehicle.mass_kg * config.vehicle.gravity_m_s2;
        let mut has_landed = |millis, estimate, share: f64| {
            course.has_landed(start + Span::from_millis(millis), estimate, share * weight_n)
        };
        assert!(!has_landed(0, &at_rest, 0.4) && !has_landed(490, &at_rest, 0.4));
        assert!(!has_landed(495, &moving, 0.4), "moved");
        assert!(!has_landed(500, &at_rest, 0.4) && !has_landed(990, &at_rest, 0.4));
        assert!(!has_landed(995, &at_rest, 0.6), "held by its thrust");
        assert!(!has_landed(1000, &at_rest, 0.4) && !has_landed(1490, &at_rest, 0.4));
        assert!(has_landed(1500, &at_rest, 0.4));
    }
}
