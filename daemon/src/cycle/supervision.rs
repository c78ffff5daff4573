//! Supervision of the cycle: safety state, mode and course of the flight; from them, the directive of the tick.

use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{ControlResponseV1, Header, ReferenceV1, VehicleV1};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::trajectory::{Phase, Trajectory};

use super::control::Directive;
use super::course::FlightCourse;
use super::first_flight::FirstFlight;
use super::intake::Intake;
use super::mode::{ModeAction, ModeConditions, transition};
use super::requests::Requests;
use super::safety::{SafetyMonitor, SafetyTick};
use crate::command::VehicleCommand;
use crate::law_guard::GuardReport;
use crate::live::FlightChange;

/// Safety, mode and course of the flight.
#[derive(Clone, Debug)]
pub(super) struct FlightSupervision {
    observe_only: bool,
    mode: Mode,
    requests: Requests,
    safety: SafetyMonitor,
    course: FlightCourse,
    /// Reasons against a flight, as of the last tick.
    obstacles: ArmingObstacles,
}

impl FlightSupervision {
    /// The supervision of flights of `trajectory`, disarmed.
    pub(super) fn new(config: &Config, trajectory: Trajectory) -> Self {
        let observe_only = config.safety.observe_only;
        let safety = SafetyMonitor::new(config);
        let is_automatic = config.safety.arm_at_start && !observe_only;
        let first_flight = if is_automatic { FirstFlight::Pending } else { FirstFlight::None };
        Self {
            observe_only,
            mode: Mode::Disarmed,
            requests: Requests { first_flight, ..Requests::default() },
            course: FlightCourse::new(config, trajectory, safety.fence().clone()),
            safety,
            obstacles: ArmingObstacles::default(),
        }
    }

    /// The mode.
    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    /// The requests that wait for the next tick.
    pub(super) fn requests(&self) -> &Requests {
        &self.requests
    }

    /// The requests, to be changed.
    pub(super) fn requests_mut(&mut self) -> &mut Requests {
        &mut self.requests
    }

    /// The safety monitor.
    pub(super) fn safety(&self) -> &SafetyMonitor {
        &self.safety
    }

    /// The safety monitor, to be changed.
    pub(super) fn safety_mut(&mut self) -> &mut SafetyMonitor {
        &mut self.safety
    }

    /// The course of the flight.
    pub(super) fn course(&self) -> &FlightCourse {
        &self.course
    }

    /// Reasons against a flight as of the last tick; none in flight.
    pub(super) fn obstacles(&self) -> ArmingObstacles {
        if self.is_flying() { ArmingObstacles::default() } else { self.obstacles }
    }

    /// Whether the daemon commands a flying vehicle.
    pub(super) fn is_flying(&self) -> bool {
        self.mode.is_armed() && !self.observe_only
    }

    /// Whether the flight is between take-off and landing, without a fault to which the daemon reacts.
    pub(super) fn is_free_flight(&self) -> bool {
        let phase = self.course.setpoint().reference.map(|reference| reference.phase);
        self.mode == Mode::Flying
            && self.safety.state() <= SafetyState::Degraded
            && matches!(phase, Some(Phase::Settle | Phase::Trajectory))
    }

    /// Records the selection between the law and its fallback.
    pub(super) fn notice_law(&mut self, guard: &GuardReport) {
        self.requests.law_fails = guard.law_fails && self.is_flying();
    }

    /// Whether the flight is held at its beginning until the motors run.
    fn is_held(&self, intake: &Intake) -> bool {
        self.is_flying() && intake.vehicle().holds_flight()
    }

    /// Takes the state of the vehicle, which changes requests: a vehicle that reports that it was stopped ends the flight, and one whose
    /// messages come from another process than before cancels a requested flight, which was meant for the previous vehicle.
    pub(super) fn receive_vehicle(
        &mut self,
        header: &Header,
        vehicle: &VehicleV1,
        intake: &Intake,
    ) {
        let is_another = intake.vehicle().source().is_some_and(|known| known != header.source);
        if is_another && self.mode == Mode::Waiting {
            self.requests.cancel_automatic();
            self.mode = Mode::Disarmed;
            self.requests.vehicle_replaced = true;
        }
        if vehicle.stopped != 0 && self.is_flying() {
            self.requests.stop = true;
        }
    }

    /// Supervises a tick, `is_fresh` if it has a pose, after the command `sent`. Returns the directive, and whether the control
    /// restarts with it.
    pub(super) fn step(
        &mut self,
        now: Time,
        is_fresh: bool,
        intake: &mut Intake,
        sent: &VehicleCommand,
    ) -> (Directive, bool) {
        self.course.begin_tick(now, &intake.estimate(), self.requests.law_fails);
        self.course.update_setpoint(now);
        self.obstacles = self.find_obstacles(now, intake);
        let is_waiting = self.mode == Mode::Waiting;
        let is_late = is_waiting && self.requests.begins_by.is_some_and(|at| now > at);
        let is_ready = is_fresh && self.obstacles.is_empty() && !is_late;
        let tick = SafetyTick {
            now,
            is_fresh,
            is_armed: self.mode.is_armed(),
            is_held: self.is_held(intake),
            is_ready,
            // A Stop lasts until a flight begins.
            is_requested: is_waiting && is_ready,
            sent,
        };
        let state = self.safety.step(&tick, intake, &mut self.requests, &mut self.course);
        let conditions = self.advance_mission(&tick, state, intake);
        let mut restarts = self.is_held(intake);
        if let Some((mode, action)) = transition(self.mode, &conditions) {
            self.mode = mode;
            restarts |= self.perform(now, action, intake);
        }
        (self.directive(now, intake), restarts)
    }

    /// Advances the mission of a flight; returns the conditions of the mode.
    fn advance_mission(
        &mut self,
        tick: &SafetyTick,
        state: SafetyState,
        intake: &Intake,
    ) -> ModeConditions {
        let SafetyTick { now, is_fresh, .. } = *tick;
        let estimate = intake.estimate();
        let is_stopped = state == SafetyState::Stop;
        let (mut lands, mut has_landed) = (false, false);
        if self.mode.is_armed() && (self.observe_only || !is_stopped) {
            let is_landing = self.mode == Mode::Landing;
            lands = self.course.follow(now, state, estimate.position, is_landing);
            if self.is_held(intake) {
                self.course.restart(now);
            } else {
                let thrust_n = tick.sent.thrust_n().unwrap_or(f64::INFINITY);
                has_landed = self.course.has_landed(now, &estimate, thrust_n);
                lands |= self.course.is_landing();
            }
        }
        ModeConditions {
            is_nominal: state <= SafetyState::Degraded,
            is_blind: matches!(state, SafetyState::Coast | SafetyState::Stop),
            is_stopped,
            is_fresh,
            is_ready: tick.is_ready,
            observes: self.observe_only,
            automatic: self.requests.begins_automatically(intake.vehicle().is_simulated()),
            now_or_never: self.requests.begins_by.is_some(),
            lands,
            has_landed,
        }
    }

    /// Performs the action of a transition; returns whether the control restarts.
    fn perform(&mut self, now: Time, action: ModeAction, intake: &mut Intake) -> bool {
        let estimate = intake.estimate();
        match action {
            ModeAction::None => return false,
            ModeAction::BeginFlight => {
                intake.begin_flight(now);
                self.course.begin_flight(now, &estimate);
                self.requests.begin_flight();
            }
            ModeAction::BeginObservation => {
                self.course.begin_observation(now, estimate.position);
            }
            ModeAction::EndFlight => {
                self.end_flight(intake);
                return false;
            }
        }
        true
    }

    fn directive(&self, now: Time, intake: &Intake) -> Directive {
        let course = &self.course;
        let turn = intake.consistency().heading_offset_rad(now);
        let Some(reference) = course.setpoint().turned(turn) else { return Directive::Disarm };
        if self.is_held(intake) {
            Directive::Idle
        } else if self.safety.state() == SafetyState::Descend {
            Directive::Descend
        } else {
            let overdue_s = course.mission().map_or(0.0, |mission| mission.overdue_s(now));
            Directive::Fly { reference, overdue_s }
        }
    }

    /// Reasons against a flight; none in flight, and one alone while the daemon only observes.
    fn find_obstacles(&self, now: Time, intake: &Intake) -> ArmingObstacles {
        if self.mode.is_armed() || self.observe_only {
            return ArmingObstacles::default()
                .with(ArmingObstacle::ObservesOnly, self.observe_only);
        }
        intake.obstacles(now, self.requests.configs_differ)
    }

    fn end_flight(&mut self, intake: &mut Intake) {
        intake.end_flight(self.safety.state() == SafetyState::Stop);
        self.course.end();
        self.mode = Mode::Disarmed;
    }

    /// Executes an operator's request and returns the reply.
    pub(super) fn request(
        &mut self,
        now: Time,
        command: OperatorCommand,
        intake: &mut Intake,
    ) -> ControlResponseV1 {
        let result = match command {
            OperatorCommand::Status => Ok(Answer::Done),
            OperatorCommand::Stop => {
                self.requests.stop = true;
                self.call_off();
                Ok(Answer::Accepted)
            }
            _ if self.observe_only => Err(Cause::ObservesOnly),
            OperatorCommand::Arm => self.arm(now, intake),
            // A repeated request: the first reply may have been lost.
            OperatorCommand::Fly if self.mode != Mode::Disarmed => Ok(Answer::Done),
            OperatorCommand::Fly if self.requests.is_called_off() => Err(Cause::Operator),
            OperatorCommand::Fly => Ok(self.wait_for_flight(None)),
            OperatorCommand::Land => self.land(now, intake),
            OperatorCommand::Disarm => self.disarm(intake),
            OperatorCommand::Resume if self.is_flying() => Ok(Answer::Accepted),
            OperatorCommand::Resume => Err(Cause::WrongMode),
            // These come with what the loop needs for them.
            _ => Err(Cause::WrongMode),
        };
        self.response(now, result, intake)
    }

    /// The reply to a request with this result.
    pub(super) fn response(
        &self,
        now: Time,
        result: Result<Answer, Cause>,
        intake: &Intake,
    ) -> ControlResponseV1 {
        let (answer, cause) = match result {
            Ok(answer) => (answer, self.safety.cause()),
            Err(cause) => (Answer::Refused, cause),
        };
        ControlResponseV1 {
            answer: answer.code(),
            mode: self.mode.code(),
            state: self.safety.state().code(),
            cause: cause.code(),
            obstacles: self.find_obstacles(now, intake).bits(),
            ..ControlResponseV1::default()
        }
    }

    /// Executes a change of the flight, or of the settings, and returns the reply.
    pub(super) fn change(
        &mut self,
        now: Time,
        change: &mut FlightChange,
        intake: &Intake,
    ) -> ControlResponseV1 {
        let result = match change {
            FlightChange::Settings(live) => {
                self.course.exchange(live);
                Ok(())
            }
            change => {
                self.require_changeable(intake).and_then(|()| self.course.change(now, change))
            }
        };
        self.response(now, result.map(|()| Answer::Done), intake)
    }

    /// Whether the course of a flight can be changed: a vehicle flies, and nothing holds or ends the flight.
    fn require_changeable(&self, intake: &Intake) -> Result<(), Cause> {
        let state = self.safety.state();
        match self.mode {
            _ if self.observe_only => Err(Cause::ObservesOnly),
            Mode::Flying if self.is_held(intake) => Err(Cause::TakeOff),
            Mode::Flying if state >= SafetyState::Hold => Err(self.safety.cause()),
            Mode::Flying => Ok(()),
            _ => Err(Cause::WrongMode),
        }
    }

    /// Takes a planner's reference, of the writer `source`, in a flight whose course can be changed.
    pub(super) fn receive_reference(
        &mut self,
        now: Time,
        source: u64,
        message: &ReferenceV1,
        intake: &Intake,
    ) {
        let is_changeable = self.require_changeable(intake).is_ok();
        let heading_rad = intake.heading_rad().filter(|_| is_changeable);
        self.course.receive_reference(now, (source, message), heading_rad);
    }

    /// Begins a flight at once, or refuses it.
    fn arm(&mut self, now: Time, intake: &Intake) -> Result<Answer, Cause> {
        if self.mode != Mode::Disarmed {
            return Err(Cause::WrongMode);
        }
        match self.find_obstacles(now, intake).iter().next() {
            None => Ok(self.wait_for_flight(Some(now + self.safety.begins_within()))),
            Some(ArmingObstacle::NoPoses) => Err(intake.missing()),
            Some(ArmingObstacle::VehicleSilent) => Err(Cause::NoVehicle),
            Some(ArmingObstacle::Stopped) => Err(Cause::Operator),
            Some(ArmingObstacle::ControlTaken) => Err(Cause::ControlTaken),
            Some(_) => Err(Cause::NotReady),
        }
    }

    /// Requests a flight that begins in the next tick, or by an instant or else not at all, or as soon as poses and vehicle permit.
    fn wait_for_flight(&mut self, begins_by: Option<Time>) -> Answer {
        self.mode = Mode::Waiting;
        self.requests.begins_by = begins_by;
        Answer::Accepted
    }

    /// Calls off a flight that has not begun, even if it is only expected; returns whether there was one.
    fn call_off(&mut self) -> bool {
        let is_waiting = self.mode == Mode::Waiting;
        self.mode = if is_waiting { Mode::Disarmed } else { self.mode };
        self.requests.call_off() || is_waiting
    }

    fn disarm(&mut self, intake: &mut Intake) -> Result<Answer, Cause> {
        if matches!(self.mode, Mode::Waiting | Mode::Disarmed) {
            self.call_off();
        } else if self.is_held(intake) {
            self.end_flight(intake);
        } else {
            return Err(Cause::WrongMode);
        }
        Ok(Answer::Done)
    }

    fn land(&mut self, now: Time, intake: &mut Intake) -> Result<Answer, Cause> {
        let is_called_off = self.call_off();
        match self.mode {
            _ if is_called_off => Ok(Answer::Done),
            _ if self.is_held(intake) => {
                self.end_flight(intake);
                Ok(Answer::Done)
            }
            Mode::Flying => {
                self.course.land(now, intake.estimate().position);
                self.mode = Mode::Landing;
                Ok(Answer::Done)
            }
            Mode::Landing => Ok(Answer::Done),
            _ => Err(Cause::WrongMode),
        }
    }
}
