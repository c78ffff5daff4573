//! The course of a flight: its mission, and the reference that is flown in a tick.

mod attitude;

use nalgebra::Vector3;
use oqtal_bus::code::{Cause, SafetyState};
use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::estimator::Estimate;
use oqtal_control::euler::EulerAngles;
use oqtal_control::trajectory::{
    Detour, FlightPlan, Leg, Phase, Reference, ReferenceMotion, StartPoint, Trajectory,
    TrajectoryOptions,
};

use crate::clearance::FloorClearance;
use crate::condition::Followed;
use crate::fence::Fence;
use crate::floor;
use crate::live::{FlightChange, LiveControl};
use crate::mission::ActiveMission;
use crate::room::StoppingRoom;
use crate::setpoint::{CheckedSetpoint, SetpointGuard};
use crate::stream::ReferenceStream;

/// Speed below which a vehicle is at rest \[m/s\].
const REST_M_S: f64 = 0.1;
/// Time for which a vehicle that landed must be at rest.
const REST: Span = Span::from_millis(500);

/// Course of a flight.
#[derive(Clone, Debug)]
pub(super) struct FlightCourse {
    observe_only: bool,
    weight_n: f64,
    trajectory: Trajectory,
    options: TrajectoryOptions,
    room: StoppingRoom,
    stream: ReferenceStream,
    /// Whether the present plan is the stop after a planner's references.
    is_after_stream: bool,
    check: SetpointGuard,
    clearance: FloorClearance,
    /// The last estimate of position \[m, world\] and velocity \[m/s, world\].
    vehicle: [Vector3<f64>; 2],
    mission: Option<ActiveMission>,
    /// The reference of this tick: it is flown, and the limits of the flight are relative to it.
    setpoint: CheckedSetpoint,
    /// Whether the check of this tick replaced the reference, or its heading.
    is_replaced: bool,
    /// The last position inside the soft border of the fence \[m, world\].
    inside: Option<Vector3<f64>>,
    /// The instant since which the vehicle, which lands, is at rest.
    at_rest_since: Option<Time>,
    /// Whether the vehicle descends without poses.
    is_descent: bool,
    /// Whether a hold began in this tick.
    begins_hold: bool,
}

impl FlightCourse {
    /// The course of flights of `trajectory` inside `fence`.
    pub(super) fn new(config: &Config, trajectory: Trajectory, fence: Fence) -> Self {
        Self {
            observe_only: config.safety.observe_only,
            weight_n: config.vehicle.mass_kg * config.vehicle.gravity_m_s2,
            options: config.trajectory.clone(),
            room: StoppingRoom::new(config),
            stream: ReferenceStream::new(config),
            is_after_stream: false,
            check: SetpointGuard::new(fence),
            clearance: FloorClearance::default(),
            vehicle: [Vector3::zeros(); 2],
            mission: None,
            setpoint: CheckedSetpoint::default(),
            is_replaced: false,
            inside: None,
            at_rest_since: None,
            is_descent: false,
            begins_hold: false,
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

    /// The reference of the plan, or of a planner, at `at`, raised above the floor like that of this tick, and with its heading turned by
    /// `offset_rad` \[rad\]; `None` without one, and while the check replaces the reference.
    pub(super) fn reference_at(&self, at: Time, offset_rad: f64) -> Option<Reference> {
        let mission = self.mission.as_ref().filter(|_| !self.is_replaced)?;
        let mut reference = self.unchecked(mission, at);
        reference.yaw_rad += offset_rad;
        Some(match self.observe_only {
            true => reference,
            false => self.clearance.raised(reference, self.room.least_m()),
        })
    }

    /// The reference of `mission`, or of a planner, at `at`, before any check.
    fn unchecked(&self, mission: &ActiveMission, at: Time) -> Reference {
        let streamed = self.stream.reference(at).filter(|_| !mission.is_held());
        streamed.unwrap_or_else(|| mission.reference(at))
    }

    /// Source of the references.
    pub(super) fn followed(&self, now: Time) -> Followed {
        match &self.mission {
            Some(_) if self.stream.is_followed() => Followed::Planner,
            Some(_) if self.is_after_stream => Followed::Ended,
            Some(_) if self.stream.is_ignored(now) => Followed::Ignored,
            Some(mission) if mission.has_arrived(now) => Followed::End,
            _ => Followed::Course,
        }
    }

    /// Whether a hold began in this tick.
    pub(super) fn begins_hold(&self) -> bool {
        self.begins_hold
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
        self.room.begin_flight(estimate.position.z);
        (self.inside, self.at_rest_since) = (None, None);
        (self.is_descent, self.is_after_stream) = (false, false);
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
        self.stream.end();
        self.mission = None;
        self.setpoint = CheckedSetpoint::default();
    }

    /// Checks the reference at `now`: once in a tick, and again where the plan has changed in it.
    pub(super) fn update_setpoint(&mut self, now: Time) {
        self.expire_stream(now);
        let Some(mission) = &self.mission else { return };
        let reference = self.unchecked(mission, now);
        self.setpoint = match self.observe_only {
            true => CheckedSetpoint { reference: Some(reference), refusal: None },
            false => self.check.pass(mission.changes(), &reference),
        };
        if !self.observe_only {
            let heights = (self.vehicle[0].z, self.room.least_m());
            let raised = |reference| self.clearance.raise(now, reference, heights);
            self.setpoint.reference = self.setpoint.reference.map(raised);
        }
        self.is_replaced = self.setpoint.refusal.is_some();
        // Of a planner's reference that was refused, the one before is followed: the check replaces nothing.
        self.setpoint.refusal = self.stream.take_refusal().or(self.setpoint.refusal);
    }

    /// Brings the vehicle to rest where a planner's references ended.
    fn expire_stream(&mut self, now: Time) {
        let Some(motion) = self.motion(now).filter(|_| self.stream.expire(now)) else { return };
        self.stop_from(now, &motion);
    }

    /// Stops from the motion of a planner's reference.
    fn stop_from(&mut self, now: Time, motion: &ReferenceMotion) {
        if let Some(mission) = &mut self.mission {
            mission.redirect(now, Detour::stay(self.room.stop(motion)));
            self.is_after_stream = true;
        }
    }

    /// Interrupts a planner's references for a hold at the reference `rest`. They are followed again after the hold; the plan until
    /// then is to stay at `rest`.
    fn interrupt_stream(&mut self, now: Time, rest: &Reference) {
        if self.stream.interrupt(now) {
            self.stop_from(now, &ReferenceMotion::between(rest, rest, 1.0));
        }
    }

    /// Ends a planner's stream; without another command the vehicle comes to rest.
    fn end_stream(&mut self, now: Time) {
        if let Some(motion) = self.motion(now).filter(|_| self.stream.is_followed()) {
            self.stop_from(now, &motion);
        }
        self.stream.end();
    }

    /// Whether the vehicle holds its position because a planner's references ended, and whether it must land because this has lasted too
    /// long.
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

    /// Takes a reference of the planner `source` for a vehicle with this heading \[rad\]; without effect without one, and during take-off
    /// and landing.
    pub(super) fn receive_reference(
        &mut self,
        now: Time,
        (source, message): (u64, &ReferenceV1),
        heading_rad: Option<f64>,
    ) {
        let heading_rad = heading_rad.filter(|_| self.require_changeable().is_ok());
        let present = self.motion(now).zip(heading_rad);
        let was_followed = self.stream.is_followed();
        let at = present.as_ref().map(|(present, heading)| (present, *heading, &self.room));
        self.stream.receive(now, (source, message), at);
        if let Some((present, _)) = present.filter(|_| self.stream.is_followed() && !was_followed) {
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
                Detour::stay(Leg::to(&motion, &target, self.room.legs()))
            }
            FlightChange::Trajectory(trajectory) => {
                let trajectory = Trajectory::clone(trajectory);
                Detour::fly(trajectory, &motion, &mission.origin(), self.room.legs())
            }
            FlightChange::Hover => Detour::stay(self.room.stop(&motion)),
            FlightChange::Settings(_) => return Ok(()),
        };
        // The reference of the stop after a fast motion is what it is.
        let is_hover = matches!(change, FlightChange::Hover);
        if !is_hover {
            self.room.require(&detour, motion.value.z)?;
        }
        self.stream.end();
        self.is_after_stream = false;
        if let Some(mission) = &mut self.mission {
            mission.redirect(now, detour);
            mission.forget_holds();
        }
        self.update_setpoint(now);
        Ok(())
    }

    /// Exchanges the options of later flights and changes with those of `live`; the flight under way is not changed.
    pub(super) fn exchange(&mut self, live: &mut LiveControl) {
        std::mem::swap(&mut self.trajectory, &mut live.trajectory);
        std::mem::swap(&mut self.options, &mut live.options);
        self.room.exchange(&mut live.room);
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
        let rest = match state {
            SafetyState::Hold => self.setpoint.at(self.holding_point(position)),
            _ => self.setpoint.at(position),
        };
        // A landing that begins in this tick is not held either: nothing would resume it.
        let is_landing = is_landing || self.is_landing();
        if state >= SafetyState::Hold && !is_landing {
            self.interrupt_stream(now, &rest);
        }
        let Some(mission) = self.mission.as_mut().filter(|_| !self.observe_only) else {
            return is_landing;
        };
        let changes = mission.changes();
        let mut lands = is_landing;
        match state {
            // Poses have come back.
            SafetyState::Land if self.is_descent => {
                mission.land_again_from(now, rest.into());
                self.is_descent = false;
            }
            SafetyState::Land if !is_landing => {
                self.land(now, position);
                lands = true;
            }
            SafetyState::Hold if !is_landing => {
                self.begins_hold = !mission.is_held();
                mission.hold(now, rest);
            }
            SafetyState::Descend => {
                mission.hold(now, rest);
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

    /// Point at which a vehicle at `position` \[m, world\] is held, at the height of the reference if that is inside. With the height of
    /// the vehicle instead, which may be below its reference, each hold would be lower than the one before.
    fn holding_point(&self, position: Vector3<f64>) -> Vector3<f64> {
        let point = self.inside.unwrap_or(position);
        let at_height = |reference: Reference| point.xy().push(reference.position.z);
        let level = self.setpoint.reference.map(at_height);
        level.filter(|level| self.room.contains(level)).unwrap_or(point)
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

    /// Whether a vehicle at `estimate` under the thrust `thrust_n` \[N\] has landed: at the floor from which it took off, or, at any
    /// height, at rest for some time under a thrust that cannot hold it in the air.
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
mod tests;
