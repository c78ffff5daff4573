//! Control cycle: poses and time in, a command out. Pure: the same object runs behind the bus and in a flight in one process.
//!
//! ```text
//!  poses, vehicle ─▶ intake ─▶ supervision ─▶ control ─▶ report ─▶ command, telemetry
//!                    guard     limits, mode   law        telemetry
//!                    tracker   course
//! ```

mod control;
mod course;
mod first_flight;
mod guarded;
mod intake;
mod mode;
mod report;
mod requests;
mod safety;
mod supervision;

use oqtal_bus::code::{Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{
    CommandV1, ControlResponseV1, ExternalV1, Header, PoseV1, ReferenceV1, Stamps, StateV1,
    TelemetryV1, VehicleV1,
};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_control::position::OuterLoop;
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::{Reference, Trajectory};

use control::{ControlTick, Directive, FlightControl};
pub use first_flight::FirstFlight;
use guarded::{GuardedControl, LawTick};
use intake::Intake;
use report::TickReport;
use supervision::FlightSupervision;

use crate::condition::Condition;
use crate::external::{ExternalLaw, LawPort};
use crate::live::FlightChange;
use crate::stack::ControlOutput;

/// Time after the last tick at which the loop acts without a pose \[periods\].
const DEADLINE_PERIODS: f64 = 1.5;
/// Least time between two commands, for a vehicle that reports no longer time of a command on its wire.
const LEAST_SPACING: Span = Span::from_nanos(500_000);

/// The output of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Sequence of the pose that the command is about; 0 for none.
    pub pose_sequence: u64,
    /// The stamps of the pose, and the instant of the wake-up.
    pub stamps: Stamps,
    /// The command.
    pub command: CommandV1,
}

/// Timing of the loop: the instants of ticks.
#[derive(Clone, Debug)]
pub struct LoopTiming {
    period: Span,
    /// Regular time from one tick to the next on a pose: the poses of cameras faster than the loop are decimated.
    spacing: Span,
    decimates: bool,
    last_tick: Time,
    /// Whether the last tick had no pose.
    was_blind: bool,
    /// The deadline of the last tick.
    deadline: Time,
}

impl LoopTiming {
    /// The timing of `config`, with a tick at `now`.
    pub fn new(config: &Config, now: Time) -> Self {
        let period = Span::period_of(config.control.rate_hz);
        let poses_per_tick = config.poses_per_tick();
        Self {
            period,
            spacing: period.scaled(1.0 - 0.5 / poses_per_tick),
            decimates: poses_per_tick > 1.0,
            last_tick: now,
            was_blind: false,
            deadline: now,
        }
    }

    /// The first instant of a tick without a new pose.
    fn earliest(&self) -> Time {
        self.last_tick + self.spacing
    }

    /// The earliest instant of a tick on a new pose, for a vehicle whose command takes the time `wire` on its wire. The wire only limits
    /// the spacing of commands: a pose after a stall is used as soon as it arrives. If poses are decimated, ticks on poses keep their
    /// regular spacing.
    fn earliest_on_pose(&self, wire: Span) -> Time {
        if self.decimates && !self.was_blind {
            return self.earliest();
        }
        self.last_tick + wire.max(LEAST_SPACING).min(self.spacing)
    }

    /// The instant of the next tick if no pose arrives before.
    pub fn latest(&self) -> Time {
        self.last_tick + self.period.scaled(DEADLINE_PERIODS)
    }

    /// The instant of the next tick if no pose arrives before, for a vehicle whose command takes `wire` on its wire; `has_fresh`: whether
    /// a pose waits that no tick has used. Such a pose is flown on as soon as the wire allows, unless poses are decimated and the next
    /// one comes soon.
    pub fn next_event(&self, has_fresh: bool, wire: Span) -> Time {
        if has_fresh && !self.decimates { self.earliest_on_pose(wire) } else { self.latest() }
    }

    /// The instant from which on a tick is due, with a pose that has just arrived, usable (`has_fresh`) or not, or without one.
    pub fn due(&self, has_arrived: bool, has_fresh: bool, wire: Span) -> Time {
        match (has_arrived, has_fresh) {
            (true, true) => self.earliest_on_pose(wire),
            (true, false) => self.earliest(),
            (false, _) => self.next_event(has_fresh, wire),
        }
    }

    /// Begins a tick, `is_blind` without a pose; returns the time since the last one \[s\].
    pub fn tick(&mut self, now: Time, is_blind: bool) -> f64 {
        let (least, most) = (self.period.scaled(0.5), self.period.scaled(2.0));
        let dt = now.since(self.last_tick).min(most).max(least);
        (self.deadline, self.last_tick, self.was_blind) = (self.latest(), now, is_blind);
        dt.seconds()
    }
}

/// The controller between its events.
#[derive(Clone, Debug)]
pub struct Cycle {
    timing: LoopTiming,
    intake: Intake,
    supervision: FlightSupervision,
    control: FlightControl,
    /// The law under its fallback; `None` if the law of `control` flies alone.
    guarded: Option<GuardedControl>,
    report: TickReport,
}

impl Cycle {
    /// The controller of `config`, ready to fly `trajectory`, disarmed at `now`.
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub fn new(config: &Config, trajectory: Trajectory, now: Time) -> Result<Self, OptionError> {
        Ok(Self {
            timing: LoopTiming::new(config, now),
            intake: Intake::new(config, &trajectory)?,
            supervision: FlightSupervision::new(config, trajectory),
            control: FlightControl::new(config)?,
            guarded: GuardedControl::new(config)?,
            report: TickReport::new(),
        })
    }

    /// The instant of the next tick if no pose arrives before.
    pub fn next_event(&self) -> Time {
        self.timing.next_event(self.intake.has_fresh(), self.intake.vehicle().wire())
    }

    /// Takes a pose, if one arrived, and acts if a tick is due, without an external law; returns `None` if not.
    pub fn step(&mut self, now: Time, arrival: Option<&(Header, PoseV1)>) -> Option<Tick> {
        self.step_with(now, arrival, &mut LawPort::default())
    }

    /// Like [`Cycle::step`], with `law` where `control.controller` is external.
    pub fn step_with(
        &mut self,
        now: Time,
        arrival: Option<&(Header, PoseV1)>,
        law: &mut dyn ExternalLaw,
    ) -> Option<Tick> {
        if let Some(arrival) = arrival {
            let is_flying = self.supervision.is_flying();
            let is_stopped = self.supervision.safety().state() == SafetyState::Stop;
            if self.intake.take_pose(now, arrival, is_flying, is_flying && !is_stopped) {
                self.report.record_pose(arrival, self.intake.tracker());
            }
        }
        let (has_fresh, wire) = (self.intake.has_fresh(), self.intake.vehicle().wire());
        let due = self.timing.due(arrival.is_some(), has_fresh, wire);
        (now >= due).then(|| self.tick(now, arrival.map(|(header, _)| header), law))
    }

    fn tick(&mut self, now: Time, arrival: Option<&Header>, law: &mut dyn ExternalLaw) -> Tick {
        let deadline = self.next_event();
        let fresh = self.intake.begin_tick(now, arrival.is_some());
        let is_fresh = fresh.is_some();
        let dt_s = self.timing.tick(now, !is_fresh);

        let sent = self.control.sent();
        let (directive, restarts) = self.supervision.step(now, is_fresh, &mut self.intake, &sent);
        let is_landing = self.supervision.mode() == Mode::Landing;
        let reference = self.supervision.course().setpoint().reference.as_ref();
        self.intake.record_course(is_landing, reference);
        if restarts {
            self.control.reset();
            self.guarded.iter_mut().for_each(GuardedControl::restart);
        }
        if self.supervision.course().begins_hold() {
            self.control.begin_stop();
            self.guarded.iter_mut().for_each(GuardedControl::begin_stop);
        }
        let tick = ControlTick { now, dt_s, is_fresh };
        let of_fallback = self.supervision.course().without_attitude(now);
        let of_stack = match (directive, of_fallback) {
            // The control stack is the fallback of an external law.
            (Directive::Fly { overdue_s, .. }, Some(reference)) if self.is_external() => {
                Directive::Fly { reference, overdue_s }
            }
            _ => directive,
        };
        let computed = self.control.compute(&tick, &of_stack, &self.intake);
        let output = self.select_law((&tick, &directive), of_fallback, computed, law);
        let [message, command] =
            self.control.command(now, &directive, output.as_ref(), &self.intake);

        self.report.record_tick(now, &self.intake, &self.supervision, output.as_ref());
        self.report.record_command(&message, self.control.riccati_counts(), is_fresh);
        let woken_for = arrival.map_or(deadline, |header| header.stamps.pose_published_at);
        self.report.record_wakeup(now.since(woken_for));
        // A repeated command is not about a pose: none was accepted.
        let stamps = fresh.as_ref().map_or_else(Stamps::default, |header| header.stamps);
        Tick {
            pose_sequence: fresh.as_ref().map_or(0, |header| header.pose_sequence),
            stamps: Stamps { woken_at: now, ..stamps },
            command,
        }
    }

    /// The output of the law that is flown, with that of the control stack, `computed`.
    fn select_law(
        &mut self,
        (tick, directive): (&ControlTick, &Directive),
        of_fallback: Option<Reference>,
        computed: Option<ControlOutput>,
        law: &mut dyn ExternalLaw,
    ) -> Option<ControlOutput> {
        let Some(guarded) = &mut self.guarded else { return computed };
        guarded.begin_tick();
        let law_tick = LawTick {
            tick,
            directive,
            intake: &self.intake,
            last: &self.control.sent(),
            course: self.supervision.course(),
            of_fallback,
            is_free: self.supervision.is_free_flight(),
        };
        let selected = computed.map(|output| guarded.select(&law_tick, output, law));
        let flown = selected.filter(|_| guarded.is_external() && !guarded.report().is_fallback);
        if let Some(output) = flown {
            self.control.yield_to(&output.command, &self.intake);
        }
        self.supervision.notice_law(guarded.report());
        self.report.record_law(guarded.report());
        selected
    }

    fn is_external(&self) -> bool {
        self.guarded.as_ref().is_some_and(GuardedControl::is_external)
    }

    /// Limits the slew of the next commands: what computes them has changed.
    fn begin_handover(&mut self) {
        match &mut self.guarded {
            Some(guarded) => guarded.begin_handover(),
            None => self.control.begin_handover(),
        }
    }

    /// Question and answer of the last tick; `None` if no external law was asked.
    pub fn exchange(&self) -> Option<(&StateV1, &ExternalV1)> {
        self.guarded.as_ref().and_then(GuardedControl::exchange)
    }

    /// Takes the state of the vehicle, and the instant at which a command took effect.
    pub fn receive_vehicle(&mut self, now: Time, header: &Header, vehicle: &VehicleV1) {
        self.supervision.receive_vehicle(header, vehicle, &self.intake);
        self.intake.receive_vehicle(now, header, vehicle);
    }

    /// Takes a reference of a planner.
    pub fn receive_reference(&mut self, now: Time, header: &Header, message: &ReferenceV1) {
        self.supervision.receive_reference(now, header.source, message, &self.intake);
    }

    /// Records that the command of the last tick was published, and returns the telemetry of that tick.
    pub fn report(&mut self, stamps: &Stamps, command_sequence: u64) -> &TelemetryV1 {
        let sent_at = stamps.command_published_at;
        self.intake.sent(command_sequence, sent_at, &self.control.sent());
        // If the tick is overdue, lateness counts from its deadline and not from its pose, which is recent.
        let deadline = self.timing.deadline;
        let due = Some(stamps.pose_published_at).filter(|at| at.is_set());
        let safety = self.supervision.safety_mut();
        safety.sent(due.map_or(deadline, |at| at.min(deadline)), sent_at);
        self.report.record_sent(command_sequence, safety.health().deadline_misses());
        self.report.telemetry()
    }

    /// Executes an operator's request and returns the reply.
    pub fn request(&mut self, now: Time, command: OperatorCommand) -> ControlResponseV1 {
        if command == OperatorCommand::Resume && self.supervision.is_flying() {
            let resumed = self.guarded.as_mut().map(GuardedControl::resume);
            if let Err(cause) = resumed.unwrap_or(Err(Cause::WrongMode)) {
                return self.supervision.response(now, Err(cause), &self.intake);
            }
        }
        self.supervision.request(now, command, &mut self.intake)
    }

    /// Executes `change` and returns the reply. Settings always take effect; the replaced ones are in `change` afterwards.
    pub fn change(&mut self, now: Time, change: &mut FlightChange) -> ControlResponseV1 {
        if let FlightChange::Settings(live) = change {
            self.control.exchange_stack(&mut live.stack, live.keeps_law);
            if let (Some(guarded), Some(live)) = (&mut self.guarded, &mut live.guarded) {
                guarded.exchange_settings(live);
            }
            self.begin_handover();
            self.intake.exchange_path(&mut live.path);
            self.supervision.safety_mut().set_motion_limits(live.limits);
            if let Some(tracker) = &live.tracker {
                self.intake.change_law(tracker);
            }
        }
        let before = self.supervision.course().prescribes_attitude();
        let response = self.supervision.change(now, change, &self.intake);
        if before != self.supervision.course().prescribes_attitude() {
            self.begin_handover();
        }
        response
    }

    /// Records whether processes of the instance run with different configurations.
    pub fn notice_configurations(&mut self, differ: bool) {
        self.supervision.requests_mut().configs_differ = differ;
    }

    /// Lands, since files of the instance were lost: no operator's request could reach another flight.
    pub fn lose_files(&mut self, now: Time) {
        self.supervision.requests_mut().files_lost = true;
        self.supervision.request(now, OperatorCommand::Land, &mut self.intake);
    }

    /// State of the flight at start-up.
    pub fn first_flight(&self) -> FirstFlight {
        self.supervision.requests().first_flight
    }

    /// The condition at `now`, for operators.
    pub fn condition(&self, now: Time) -> Condition {
        let course = self.supervision.course();
        let condition = Condition::of(self.telemetry(), self.first_flight(), course.followed(now));
        Condition { refusal: course.setpoint().refusal, ..condition }
    }

    /// Cancels the automatic flight at start-up: only an operator may begin the next one; in Stop, if a daemon `ended_in_flight` before.
    pub fn cancel_automatic(&mut self, ended_in_flight: bool) {
        let requests = self.supervision.requests_mut();
        requests.cancel_automatic();
        requests.ended_in_flight = ended_in_flight;
    }

    /// Whether only an operator's `arm` may begin the next flight.
    pub fn awaits_arm(&self) -> bool {
        self.supervision.requests().awaits_arm()
    }

    /// Records that the command which started the daemon will request a flight: until then an operator can call it off.
    pub fn expect_flight(&mut self) {
        self.supervision.requests_mut().expect_flight();
    }

    /// Replaces the gains of one of the outer loops of Fig. 16, in flight; gains that do not pass their check are refused.
    ///
    /// # Errors
    /// The first gain that is not allowed.
    pub fn set_loop(&mut self, which: OuterLoop, gains: PidGains) -> Result<(), OptionError> {
        gains.check()?;
        self.control.set_loop(which, gains);
        Ok(())
    }

    /// The telemetry of the last tick.
    pub fn telemetry(&self) -> &TelemetryV1 {
        self.report.telemetry()
    }
}

#[cfg(test)]
mod tests;
