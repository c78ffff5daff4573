//! Modes of the daemon: disarmed, waiting, flying, landing.

use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::time::Time;
use oqtal_control::estimator::Estimate;
use oqtal_control::euler::EulerAngles;
use oqtal_control::trajectory::{FlightPlan, Phase, StartPoint};

use super::Cycle;
use super::at_start::AtStart;
use crate::mission::ActiveMission;
use crate::setpoint::CheckedSetpoint;

impl Cycle {
    /// Whether the daemon commands a flying vehicle.
    pub(super) fn is_flying(&self) -> bool {
        self.is_armed() && !self.observe_only
    }

    /// Whether a mission is under way, flown or only observed.
    pub(super) fn is_armed(&self) -> bool {
        matches!(self.mode, Mode::Flying | Mode::Landing)
    }

    /// Whether the flight is held at its beginning until the motors run.
    pub(super) fn is_held(&self) -> bool {
        self.is_flying() && self.vehicle.holds_flight()
    }

    /// Changes the mode for this tick.
    pub(super) fn change_mode(&mut self, now: Time, fresh: bool) {
        let estimate = self.estimator.latest();
        let by_itself = self.takes_off_by_itself();
        let may_begin = fresh && self.memory.obstacles.is_empty();
        match (self.mode, self.supervisor.state()) {
            (Mode::Disarmed, SafetyState::Nominal | SafetyState::Degraded)
                if may_begin && by_itself =>
            {
                self.begin_flight(now, &estimate);
            }
            (Mode::Disarmed, SafetyState::Nominal | SafetyState::Degraded) if self.observe_only => {
                self.stack.active_mut().reset();
                self.mission = Some(ActiveMission::observe(estimate.position, now));
                self.mode = Mode::Flying;
                self.check_setpoint(now);
            }
            // `arm` begins a flight at once or not at all: poses were good when the operator asked.
            (Mode::Waiting, SafetyState::Nominal | SafetyState::Degraded) if may_begin => {
                self.begin_flight(now, &estimate);
            }
            (Mode::Waiting, _) if self.requests.arms_at_once && fresh => {
                self.mode = Mode::Disarmed;
            }
            (Mode::Waiting, SafetyState::Coast | SafetyState::Stop)
                if self.requests.arms_at_once =>
            {
                self.mode = Mode::Disarmed;
            }
            (Mode::Flying | Mode::Landing, SafetyState::Stop) if !self.observe_only => {
                self.end_flight();
            }
            (Mode::Flying | Mode::Landing, state) => {
                let plan = self.plan_changes();
                self.act_on(now, state);
                if self.plan_changes() != plan {
                    self.check_setpoint(now);
                }
                self.go_on(now, &estimate);
            }
            _ => {}
        }
    }

    /// Number of changes of the plan so far \[-\]; `None` without a flight.
    fn plan_changes(&self) -> Option<u32> {
        self.mission.as_ref().map(ActiveMission::changes)
    }

    /// Holds the position, lands or waits for the end of a descent if the safety state demands it, and goes on with the mission if
    /// it does no longer.
    fn act_on(&mut self, now: Time, state: SafetyState) {
        let position = self.estimator.latest().position;
        let Some(mission) = self.mission.as_mut().filter(|_| !self.observe_only) else { return };
        let at = |point| self.memory.setpoint.at(point);
        match state {
            // Poses have come back.
            SafetyState::Land if self.memory.descends => {
                mission.land_from(now, at(position).into());
                self.memory.descends = false;
            }
            SafetyState::Land if self.mode == Mode::Flying => self.land_early(now),
            SafetyState::Hold if self.mode == Mode::Flying => {
                mission.hold(now, at(self.memory.inside.unwrap_or(position)));
            }
            SafetyState::Descend => {
                mission.hold(now, at(position));
                (self.memory.descends, self.mode) = (true, Mode::Landing);
            }
            // Blindness interrupts neither.
            SafetyState::Nominal | SafetyState::Degraded => mission.resume(now),
            _ => {}
        }
    }

    /// Lands above the present position, from the height and at the heading of the reference that was flown last.
    pub(super) fn land_early(&mut self, now: Time) {
        let position = self.estimator.latest().position;
        let height = self.memory.setpoint.reference.map_or(position.z, |last| last.position.z);
        if let Some(mission) = &mut self.mission {
            let point = self.memory.setpoint.at(position.xy().push(height));
            mission.land_from(now, point.into());
            self.mode = Mode::Landing;
        }
    }

    /// Checks the reference at `now`: once in a tick, and again where the plan has changed in it.
    pub(super) fn check_setpoint(&mut self, now: Time) {
        let Some(mission) = &self.mission else { return };
        let reference = mission.reference(now);
        self.memory.setpoint = match self.observe_only {
            true => CheckedSetpoint { reference: Some(reference), is_refused: false },
            false => self.setpoint.pass(mission.changes(), &reference),
        };
    }

    /// Ends the flight: motors off.
    pub(super) fn end_flight(&mut self) {
        self.guard.motion.end();
        self.mission = None;
        self.memory.setpoint = CheckedSetpoint::default();
        self.mode = Mode::Disarmed;
    }

    fn begin_flight(&mut self, now: Time, estimate: &Estimate) {
        let start = StartPoint {
            position: estimate.position,
            yaw_rad: EulerAngles::from_attitude(&estimate.attitude).yaw,
        };
        let plan = FlightPlan::new(&self.options, self.trajectory.clone(), start);
        self.stack.active_mut().reset();
        self.vehicle.begin_flight(now);
        self.guard.begin_flight();
        self.setpoint.reset();
        (self.memory.inside, self.memory.stands_since) = (None, None);
        self.memory.descends = false;
        self.mission = Some(ActiveMission::fly(plan, estimate.position.z, now));
        self.mode = Mode::Flying;
        self.check_setpoint(now);
        if self.requests.at_start == AtStart::Awaited {
            self.requests.at_start = AtStart::Taken;
        }
    }

    /// Holds a flight whose motors do not run yet, and notices the landing.
    fn go_on(&mut self, now: Time, estimate: &Estimate) {
        if self.is_held() {
            self.stack.active_mut().reset();
            if let Some(mission) = &mut self.mission {
                mission.restart(now);
            }
            self.check_setpoint(now);
            return;
        }
        let (Some(mission), Some(reference)) = (&self.mission, self.memory.setpoint.reference)
        else {
            return;
        };
        if mission.has_landed(&reference, estimate) || self.stands(now, reference.phase) {
            self.end_flight();
        } else if reference.phase == Phase::Landing {
            self.mode = Mode::Landing;
        }
    }
}
