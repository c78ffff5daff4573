//! Safety monitor of the cycle: the conditions of a tick, and the safety state that follows from them.

use oqtal_bus::code::{Cause, SafetyState};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use super::course::FlightCourse;
use super::intake::Intake;
use super::requests::Requests;
use crate::command::VehicleCommand;
use crate::descent::BlindDescent;
use crate::fence::Fence;
use crate::guard::AcceptedPose;
use crate::limits::{FlightLimits, FlightView, LimitConditions, LoopLimits};
use crate::loop_health::{LoopHealth, TickFrames};
use crate::supervisor::{SafetyConditions, Supervisor};

/// Gap after which the first good pose is accepted at once \[periods\]; after longer gaps several are needed.
const SHORT_GAP_PERIODS: f64 = 6.0;

/// Time from an accepted arm to the flight, shorter than an operator waits for it.
const BEGINS_WITHIN: Span = Span::from_millis(500);

/// The tick that the monitor evaluates.
#[derive(Clone, Copy, Debug)]
pub(super) struct SafetyTick<'a> {
    /// The present instant.
    pub(super) now: Time,
    /// Whether the tick has a pose.
    pub(super) is_fresh: bool,
    /// Whether a mission is active, flown or only observed.
    pub(super) is_armed: bool,
    /// Whether the flight is held at its beginning until the motors run.
    pub(super) is_held: bool,
    /// Whether the tick has a pose, and a flight is possible.
    pub(super) is_ready: bool,
    /// Whether an operator has requested a flight that begins with this tick.
    pub(super) is_requested: bool,
    /// The command that was sent in the last tick.
    pub(super) sent: &'a VehicleCommand,
}

/// Supervisor, limits and health of the loop.
#[derive(Clone, Debug)]
pub(super) struct SafetyMonitor {
    observe_only: bool,
    period: Span,
    /// Time without accepted poses in flight after which the motors stop.
    coast: Span,
    /// Good poses in a row after which poses are accepted again.
    recovery_poses: u32,
    descent: BlindDescent,
    supervisor: Supervisor,
    limits: FlightLimits,
    health: LoopHealth,
    /// The last tick on an accepted pose in Nominal or Degraded.
    last_nominal: Option<Time>,
    /// Instant of the last tick, if it was in flight.
    last_flight_tick: Option<Time>,
}

impl SafetyMonitor {
    /// The monitor of `config`, in Coast until poses arrive.
    pub(super) fn new(config: &Config) -> Self {
        Self {
            observe_only: config.safety.observe_only,
            period: Span::period_of(config.control.rate_hz),
            coast: Span::from_seconds(config.safety.coast_ms * 1e-3),
            recovery_poses: config.safety.recovery_poses,
            descent: BlindDescent::of(config),
            supervisor: Supervisor::default(),
            limits: FlightLimits::new(config),
            health: LoopHealth::new(config),
            last_nominal: None,
            last_flight_tick: None,
        }
    }

    /// Longest time from an accepted arm to the flight.
    pub(super) fn begins_within(&self) -> Span {
        self.coast.min(BEGINS_WITHIN)
    }

    /// The safety state.
    pub(super) fn state(&self) -> SafetyState {
        self.supervisor.state()
    }

    /// Why the state is not Nominal.
    pub(super) fn cause(&self) -> Cause {
        self.supervisor.cause()
    }

    /// The fence.
    pub(super) fn fence(&self) -> &Fence {
        &self.limits.fence
    }

    /// Replaces the limits of the motion.
    pub(super) fn set_motion_limits(&mut self, limits: LoopLimits) {
        self.limits.set_motion(limits);
    }

    /// Health of poses and ticks.
    pub(super) fn health(&self) -> &LoopHealth {
        &self.health
    }

    /// Records the command sent at `sent_at`, which was due at `due`.
    pub(super) fn sent(&mut self, due: Time, sent_at: Time) {
        self.health.sent(due, sent_at);
    }

    /// Evaluates the table of limits. Takes the requests that end a flight, and records stops and positions inside the fence.
    pub(super) fn step(
        &mut self,
        tick: &SafetyTick,
        intake: &Intake,
        requests: &mut Requests,
        course: &mut FlightCourse,
    ) -> SafetyState {
        let limits = self.limit_conditions(tick, intake, requests, course);
        let conditions = SafetyConditions { limits, ..self.conditions(tick, intake, requests) };
        let state = self.supervisor.step(tick.now, &conditions, intake.missing());
        if !tick.is_armed {
            self.supervisor.renew_cause(intake.missing());
        }
        requests.awaits_arm |= state == SafetyState::Stop;
        if state <= SafetyState::Degraded && tick.is_fresh {
            self.last_nominal = Some(tick.now);
        }
        state
    }

    /// The conditions of this tick but for the limits.
    fn conditions(
        &self,
        tick: &SafetyTick,
        intake: &Intake,
        requests: &mut Requests,
    ) -> SafetyConditions {
        let SafetyTick { now, is_fresh, is_armed, .. } = *tick;
        let (age, vehicle) = (intake.pose_age(now), intake.vehicle());
        let is_flying = is_armed && !self.observe_only;
        let is_short_gap = self.cause() == Cause::NoPose
            && self
                .last_nominal
                .is_some_and(|at| now.since(at) <= self.period.scaled(SHORT_GAP_PERIODS));
        let needed = if is_short_gap { 1 } else { self.recovery_poses };
        let blind_too_long = is_armed && age.is_none_or(|age| age > self.coast);
        SafetyConditions {
            poses_missing: intake.poses_missing(now),
            poses_good: is_fresh && intake.guard().good_in_a_row() >= needed,
            may_descend: is_flying && !tick.is_held && self.may_descend(now, intake),
            // Predicted only for a blind vehicle.
            is_down: blind_too_long && is_down(now, intake),
            blind_too_long,
            // A recording has no vehicle.
            vehicle_silent: !is_armed && !self.observe_only && !vehicle.answers(now),
            vehicle_lost: std::mem::take(&mut requests.vehicle_replaced)
                || is_flying && vehicle.is_lost(now),
            motors_do_not_run: is_flying && vehicle.has_no_motors(now),
            control_taken: is_flying && vehicle.control_is_taken(),
            operator_stops: std::mem::take(&mut requests.stop),
            ended_in_flight: std::mem::take(&mut requests.ended_in_flight),
            // No operator arms a recording: its state follows its poses.
            operator_arms: tick.is_requested || self.observe_only,
            is_flying,
            limits: LimitConditions::default(),
        }
    }

    /// Whether the vehicle may descend without poses: it has its own attitude loop, was in the air at the last pose, its motion is known, and
    /// it has not descended for too long.
    fn may_descend(&self, now: Time, intake: &Intake) -> bool {
        let is_possible =
            |last: &AcceptedPose| self.descent.is_possible(now.since(last.captured_at));
        // If poses contradicted the vehicle or the motion predicted from earlier ones, those may have been wrong.
        let is_known = !(intake.contradicts_motion() || intake.consistency().is_disputed());
        (is_known || self.supervisor.state() == SafetyState::Descend)
            && !intake.consistency().contradicts()
            && intake.was_airborne()
            && intake.last_pose().is_some_and(is_possible)
    }

    /// The limits of this tick. In flight the motion is that at the instant at which a command takes effect.
    fn limit_conditions(
        &mut self,
        tick: &SafetyTick,
        intake: &Intake,
        requests: &Requests,
        course: &mut FlightCourse,
    ) -> LimitConditions {
        let guard = intake.guard();
        let age = intake.pose_age(tick.now).filter(|_| tick.is_fresh);
        let frames = TickFrames { accepted: guard.accepted(), bad: guard.lost() + guard.refused() };
        self.health.tick(age, frames);
        let last = std::mem::replace(&mut self.last_flight_tick, tick.is_armed.then_some(tick.now));
        if tick.is_armed && last.is_none() {
            self.health.begin_flight();
        }
        let paused = last.map(|last| tick.now.since(last));
        let configs_differ = requests.configs_differ;
        let mut conditions = LimitConditions { configs_differ, ..LimitConditions::default() };
        if !tick.is_armed || self.observe_only {
            return conditions;
        }
        self.health.check(&mut conditions);
        // Without commands for so long, the vehicle has fallen, or acts on its own time-out: the motors must not start again.
        conditions.stood_still = paused.is_some_and(|pause| pause > self.coast);
        conditions.law_fails = requests.law_fails;
        conditions.files_lost = requests.files_lost;
        conditions.poses_contradict = intake.consistency().contradicts();
        conditions.stays_on_floor = intake.consistency().stays_on_floor();
        conditions.poses_disagree = intake.consistency().disagrees() && !intake.is_vehicle_silent();
        conditions.setpoint_refused = course.setpoint().refusal.is_some();
        [conditions.references_ended, conditions.references_overdue] =
            course.stream_ended(tick.now);
        // Why present references are refused is reported before the end of earlier ones.
        conditions.references_ended &= !conditions.setpoint_refused;
        // Also during pauses of a poor link: otherwise each pause would restart the delay of a limit.
        if let Some(vehicle) = intake.vehicle().last_message(tick.now) {
            self.limits.check_vehicle(vehicle, &mut conditions);
        }
        self.check_motion(tick, intake, course, &mut conditions);
        conditions.poses_mislead =
            conditions.poses_disagree && (conditions.far_off || conditions.too_fast);
        conditions
    }

    fn check_motion(
        &self,
        tick: &SafetyTick,
        intake: &Intake,
        course: &mut FlightCourse,
        conditions: &mut LimitConditions,
    ) {
        // A Stop of the next tick, whose command is late by a period, takes effect then.
        let acts_at = tick.now + self.period.scaled(2.0);
        let tracker = intake.tracker();
        let motion = tracker.predict_coarsely(acts_at.seconds() + tracker.delay_s());
        let (Some(mission), Some(reference), Some(motion)) =
            (course.mission(), &course.setpoint().reference, &motion)
        else {
            return;
        };
        conditions.landing_overdue = mission.is_landing_overdue(tick.now);
        conditions.held_too_long = mission.is_held_too_long(tick.now);
        let flight = FlightView {
            motion,
            floor_m: tracker.floor_m(),
            reference,
            thrust_n: tick.sent.thrust_n().unwrap_or(0.0),
            is_descent: self.state() == SafetyState::Descend,
        };
        self.limits.check(&flight, conditions);
        if !conditions.in_fence_margin {
            course.record_inside(motion.motion.position);
        }
    }
}

/// Whether the predicted motion has reached the floor.
fn is_down(now: Time, intake: &Intake) -> bool {
    let tracker = intake.tracker();
    let track = tracker.predict_coarsely(now.seconds());
    track.is_some_and(|track| track.is_at_floor(tracker.floor_m()))
}
