//! Selection of the set-point that is sent to the vehicle: the newest command within its timeout, else the zero set-point. Depends
//! on the bridge's own clock alone, not on format, transport or daemon.
//!
//! The age of a command is counted from its publication, stamped by the daemon with the clock of the same machine, and from its
//! arrival: both must be within the timeout. A stamp that is missing or lies in the future is rejected. A command that waited in a
//! buffer while this process was suspended is therefore never sent.

use oqtal_bus::code::{Actuation, ControlHolder};
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::stop::StoppedMotors;
use oqtal_bus::time::{Span, Time};

use crate::motors::{MotorConditions, MotorEvent, MotorSequencer, MotorState};
use crate::protocol::ReportedMotors;
use crate::setpoint::VehicleSetpoint;

/// Command that a set-point forwards for the first time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForwardedCommand {
    /// Sequence of the command \[-\].
    pub command: u64,
    /// Sequence of the pose that the command is about \[-\].
    pub pose: u64,
    /// Stamps of the command, including its arrival at the bridge.
    pub stamps: Stamps,
}

/// Motor state that the vehicle last reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorStatus {
    /// Arrival of the report.
    pub received_at: Time,
    /// The motors.
    pub motors: ReportedMotors,
}

/// Kind of command that passes the command gate, and its timeouts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyLimits {
    /// Actuation of commands that the vehicle takes.
    pub accepts: Actuation,
    /// Command timeout: a command published longer ago is not sent.
    pub command_age: Span,
    /// Status timeout: an older status does not count for a motor sequence.
    pub status_age: Span,
    /// Longest duration of a motor sequence.
    pub sequence: Span,
    /// Rest time: "disarmed" is commanded for this time before the motors are stopped.
    pub rest: Span,
}

/// Newest accepted command.
#[derive(Clone, Copy, Debug)]
struct Newest {
    forwarded: ForwardedCommand,
    command: CommandV1,
    is_forwarded: bool,
}

/// Selects the content of each set-point frame.
#[derive(Clone, Debug)]
pub struct CommandGate {
    limits: SafetyLimits,
    motors: MotorSequencer,
    newest: Option<Newest>,
    status: Option<MotorStatus>,
    control: ControlHolder,
    /// While another has control: whether a stop was withheld since; `None` otherwise.
    withholds: Option<bool>,
    /// Whether no flight had been requested for a command timeout since the port was opened, so that a request could be executed.
    is_ready: bool,
    /// Instant of the last flight request.
    last_request: Time,
    /// Instant since which "disarmed" has been commanded.
    disarmed_since: Option<Time>,
    /// Instant since which an operator's stop is in force.
    stopped_since: Option<Time>,
    rejected: u64,
}

impl CommandGate {
    /// Gate to a vehicle of unknown state.
    pub fn new(now: Time, limits: SafetyLimits) -> Self {
        Self {
            limits,
            motors: MotorSequencer::new(now, limits.sequence, limits.status_age),
            newest: None,
            status: None,
            control: ControlHolder::Nobody,
            withholds: None,
            is_ready: false,
            last_request: now,
            disarmed_since: None,
            stopped_since: None,
            rejected: 0,
        }
    }

    /// Discards the state of the vehicle and inhibits flight after a port was opened or lost.
    pub fn reset(&mut self, now: Time) {
        self.motors.inhibit(now);
        (self.status, self.control) = (None, ControlHolder::Nobody);
        (self.is_ready, self.last_request) = (false, now);
    }

    /// Takes a command that arrived at `now`; returns whether it is accepted: within its timeout and newer than the last.
    pub fn receive(&mut self, now: Time, header: &Header, command: CommandV1) -> bool {
        let published_at = header.stamps.command_published_at;
        let newer = self
            .newest
            .is_none_or(|last| published_at >= last.forwarded.stamps.command_published_at);
        // The final "disarmed" of a daemon has no stamps; it is safe at any age.
        let is_flight = self.is_flight(&command);
        let is_final = !is_flight && !published_at.is_set();
        let accepted = is_final || newer && is_within(now, published_at, self.limits.command_age);
        if !accepted {
            self.rejected += 1;
            return false;
        }
        let stamps = Stamps { received_at: now, ..header.stamps };
        let forwarded =
            ForwardedCommand { command: header.sequence, pose: header.pose_sequence, stamps };
        self.newest = Some(Newest { forwarded, command, is_forwarded: false });
        if is_flight {
            self.disarmed_since = None;
        } else {
            self.disarmed_since = self.disarmed_since.or(Some(now));
        }
        true
    }

    /// Sets the instant since which an operator's stop is in force: no flight command is forwarded, and the motors are stopped at
    /// once, without the rest time, whoever started them. A flight command that arrived before it ends is never sent.
    pub fn keep_stopped(&mut self, since: Option<Time>) {
        self.stopped_since = since;
        self.newest = self.newest.filter(|newest| !self.is_flight(&newest.command));
    }

    /// The motors, as a status that arrived since an operator's stop reports them.
    pub fn stopped_motors(&self) -> StoppedMotors {
        let status =
            self.status.filter(|s| self.stopped_since.is_some_and(|at| s.received_at > at));
        match status {
            None => StoppedMotors::Unknown,
            // A toggle that was sent may still take effect.
            Some(status)
                if status.motors.are_armed()
                    || self.is_in_sequence()
                    || self.motors.may_start() =>
            {
                StoppedMotors::Running
            }
            Some(_) => StoppedMotors::Off,
        }
    }

    /// Takes the motor state that the vehicle reports.
    pub fn update_status(&mut self, status: MotorStatus) {
        self.status = Some(status);
    }

    /// Takes the holder of the control of the vehicle.
    pub fn update_control(&mut self, control: ControlHolder) {
        self.control = control;
    }

    /// Holder of the control of the vehicle.
    pub fn control(&self) -> ControlHolder {
        self.control
    }

    /// Whether a flight could have begun since the port was opened. An earlier request has no effect, however long it lasts, so the
    /// vehicle must not be reported as waiting for one.
    pub fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// Whether another has control: no set-point is sent.
    pub fn is_released(&self) -> bool {
        self.control == ControlHolder::Another
    }

    /// Selects the set-point of a frame that begins at `now`; returns it, the command that it forwards for the first time, and
    /// the event of the motors.
    pub fn select_command(
        &mut self,
        now: Time,
    ) -> (VehicleSetpoint, Option<ForwardedCommand>, Option<MotorEvent>) {
        let flight = self.flight(now);
        if flight.is_some() {
            self.last_request = now;
        }
        if self.is_released() {
            return (VehicleSetpoint::Released, None, self.release(now));
        }
        self.withholds = None;
        let conditions = self.conditions(now, flight.is_some());
        let event = self.motors.step(now, conditions);
        self.is_ready |= self.motors.state() != MotorState::Inhibited;
        let setpoint = match (self.motors.state(), flight) {
            (MotorState::Running, Some(command)) => VehicleSetpoint::Fly(command),
            // Start and stop are one toggle: sent only while a status shows that it is needed.
            (MotorState::Starting, Some(_)) if conditions.stopped => VehicleSetpoint::StartMotors,
            // Also if a flight is requested meanwhile: half a toggle leaves the motors in either state.
            (MotorState::Stopping, _) if conditions.armed => VehicleSetpoint::StopMotors,
            _ => VehicleSetpoint::Zero,
        };
        (setpoint, self.forward(now, &setpoint), event)
    }

    /// Leaves the motors to another holder of control; returns the event to be logged: that control was taken, or that an operator's stop
    /// is withheld.
    fn release(&mut self, now: Time) -> Option<MotorEvent> {
        self.motors.release(now);
        let is_stopped = self.stopped_since.is_some();
        let before = self.withholds.replace(is_stopped);
        match (before, is_stopped) {
            (None | Some(false), true) => Some(MotorEvent::StopWithheld),
            (None, false) => Some(MotorEvent::ControlTaken),
            _ => None,
        }
    }

    /// Whether the start sequence is being sent.
    pub fn is_starting(&self) -> bool {
        self.motors.state() == MotorState::Starting
    }

    /// Whether a motor sequence is being sent: a fresh status is then urgent.
    pub fn is_in_sequence(&self) -> bool {
        matches!(self.motors.state(), MotorState::Starting | MotorState::Stopping)
    }

    /// Whether the motors may run because of what the bridge sent.
    pub fn may_run(&self) -> bool {
        self.motors.may_run()
    }

    /// Whether the emergency stop may be sent to motors that do not stop: not if a pilot may have started them.
    pub fn may_stop_at_once(&self) -> bool {
        !self.motors.stops_others() || self.control == ControlHolder::Bridge
    }

    /// Motors as the last status, of any age, reports them. Without a new status they are not assumed to have stopped; a motor sequence
    /// requires a fresh one.
    pub fn last_motors(&self) -> Option<ReportedMotors> {
        self.status.map(|status| status.motors)
    }

    /// Whether the state of the motors is known at `now`: reported as armed at any time, or as off within `silence` and the status
    /// time-out. Another host may have started motors that were last reported as off before.
    pub fn knows_motors(&self, now: Time, silence: Span) -> bool {
        let age = self.limits.status_age.max(silence);
        self.status.is_some_and(|status| {
            status.motors.are_armed() || is_within(now, status.received_at, age)
        })
    }

    /// Number of commands rejected: past their timeout, stamped in the future, or older than the one before.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Instant at which the newest command times out; `None` if it does not fly.
    pub fn times_out_at(&self) -> Option<Time> {
        let newest =
            self.newest.filter(|it| self.stopped_since.is_none() && self.is_flight(&it.command))?;
        let Stamps { command_published_at, received_at, .. } = newest.forwarded.stamps;
        Some(command_published_at.min(received_at) + self.limits.command_age + Span::from_nanos(1))
    }

    /// Whether flight commands are forwarded.
    pub fn is_flying(&self) -> bool {
        self.motors.state() == MotorState::Running && !self.is_released()
    }

    /// The newest command, if it is a flight command within its timeout at `now`.
    fn flight(&self, now: Time) -> Option<CommandV1> {
        let newest = self.newest.filter(|newest| self.is_flight(&newest.command))?;
        if self.stopped_since.is_some() {
            return None;
        }
        let Stamps { command_published_at, received_at, .. } = newest.forwarded.stamps;
        let within = |since| is_within(now, since, self.limits.command_age);
        (within(command_published_at) && within(received_at)).then_some(newest.command)
    }

    fn conditions(&self, now: Time, requested: bool) -> MotorConditions {
        let fresh = self.status.filter(|s| is_within(now, s.received_at, self.limits.status_age));
        let without_request = now.since(self.last_request);
        let rested = |since: Time| now.since(since) >= self.limits.rest;
        let is_stopped = self.stopped_since.is_some();
        let silent =
            !is_stopped && self.disarmed_since.is_none() && without_request >= self.limits.rest;
        MotorConditions {
            requested,
            idle: without_request > self.limits.command_age,
            disarmed: self.disarmed_since.is_some() || is_stopped,
            rest_over: (self.disarmed_since.is_some_and(rested) || is_stopped) && !requested,
            daemon_silent: (silent && !requested).then_some(without_request),
            running: fresh.is_some_and(|status| status.motors == ReportedMotors::Running),
            armed: fresh.is_some_and(|status| status.motors.are_armed()),
            stopped: fresh.is_some_and(|status| !status.motors.are_armed()),
            operator_stop: is_stopped,
            ..MotorConditions::default()
        }
    }

    /// The newest command, if `setpoint` is the first that executes it.
    fn forward(&mut self, now: Time, setpoint: &VehicleSetpoint) -> Option<ForwardedCommand> {
        let mut newest = self.newest.filter(|newest| !newest.is_forwarded)?;
        let published_at = newest.forwarded.stamps.command_published_at;
        let within = is_within(now, published_at, self.limits.command_age);
        let executes = match setpoint {
            VehicleSetpoint::Fly(_) => true,
            VehicleSetpoint::Zero => !self.is_flight(&newest.command) && within,
            VehicleSetpoint::StartMotors
            | VehicleSetpoint::StopMotors
            | VehicleSetpoint::Released => false,
        };
        newest.is_forwarded = executes;
        self.newest = Some(newest);
        executes.then_some(newest.forwarded)
    }

    /// Whether `command` is a flight command: of the vehicle's actuation, all numbers finite. Every other command counts as
    /// "disarmed".
    fn is_flight(&self, command: &CommandV1) -> bool {
        is_flight(command, self.limits.accepts)
    }
}

/// Whether `command` is a flight command of the actuation `accepts`, all numbers finite.
pub(crate) fn is_flight(command: &CommandV1, accepts: Actuation) -> bool {
    let CommandV1 { sticks, attitude, thrust, .. } = command;
    let numbers = sticks.iter().chain(attitude).chain([thrust]);
    Actuation::from_code(command.actuation) == Some(accepts)
        && numbers.into_iter().all(|number| number.is_finite())
}

/// Whether the stamp `since` is set, not in the future, and no older than `age`.
pub(crate) fn is_within(now: Time, since: Time, age: Span) -> bool {
    since.is_set() && since <= now && now.since(since) <= age
}
