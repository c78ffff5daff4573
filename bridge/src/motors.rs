//! State machine of the vehicle's motors: five states, and the transitions between them as one table.
//!
//! ```text
//!              idle     requested, not running           running           rest over, armed
//!   Inhibited ──────▶ Off ───────────────────▶ Starting ─────────▶ Running ──────────────────▶ Stopping
//!    ▲                 ▲└────── requested, running ────────────────▲ │                          │  │
//!    │                 └──────────────── stopped ────────────────────┴──────────────────────────┘  │
//!    └───── a sequence timed out, the daemon is silent, motors stopped in flight or in a start ─────┘
//! ```
//!
//! Sources of the rules:
//!
//! - Start and stop are the same frame, no thrust and full yaw, sent until it takes effect: a *toggle*. `asctec_drivers` sends
//!   it up to 15 times, 0.2 s apart, until `LL_STATUS` reports running motors; `asctec_mav_framework` holds it for at most 1.5 s.
//!   Here it is sent only while a fresh status shows that it is needed, and for a bounded time.
//! - Ours: flight is never resumed after a loss. After a port was opened, and after a sequence failed, the state is `Inhibited`:
//!   the zero set-point is sent until no flight has been requested for a command timeout. A bridge that is restarted in flight
//!   therefore does not start motors.
//! - Ours: motors are stopped only after the daemon has commanded "disarmed" for `bridge.rest-ms`. Without a daemon there are no
//!   commands: zero set-points are sent, and the rotors idle until a daemon runs again or the pilot stops them.
//! - Ours: if another takes control, the state is `Inhibited` and the motors are under the control of that pilot or program:
//!   nothing is sent, not even a zero set-point, because it would drop a vehicle that a pilot flies.
//! - Ours: only an operator's stop stops motors that the bridge did not start, such as those of a vehicle that was flying when the
//!   bridge was restarted. Otherwise they are left alone, because a pilot may fly by hand while a bridge is connected.
//! - The emergency stop is known from `asctec_drivers` alone; no source states how to fly again after it. It is sent only after a stop
//!   sequence that failed, and when the bridge ends while motors run; never to motors that a pilot may have started. A Stop of the
//!   daemon in flight is a zero set-point, then the stop sequence.

use oqtal_bus::time::{Span, Time};

/// Time after a toggle during which a status may still be older than the toggle.
const SETTLING_TIME: Span = Span::from_millis(500);

/// State of the motors as the bridge controls them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotorState {
    /// Zero set-point; a flight request has no effect until none has been received for a command timeout.
    #[default]
    Inhibited,
    /// Zero set-point; a flight request starts the motors.
    Off,
    /// The start sequence is being sent.
    Starting,
    /// Commands are forwarded.
    Running,
    /// The stop sequence is being sent.
    Stopping,
}

/// Inputs of the state machine. A condition that is unknown is false.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorConditions {
    /// The newest command is a flight command within its timeout.
    pub requested: bool,
    /// No flight has been requested for longer than the command timeout.
    pub idle: bool,
    /// The newest command is "disarmed".
    pub disarmed: bool,
    /// "Disarmed" has been commanded for the rest time, so that the vehicle stands.
    pub rest_over: bool,
    /// A fresh status reports motors that follow set-points.
    pub running: bool,
    /// A fresh status reports motors that run, or that will once they have spooled up.
    pub armed: bool,
    /// A fresh status reports stopped motors.
    pub stopped: bool,
    /// An operator's stop is in force: motors are stopped whoever started them.
    pub operator_stop: bool,
    /// Time since a flight was last requested, if no command followed for the rest time; `None` otherwise.
    pub daemon_silent: Option<Span>,
    /// The bridge started the motors, and no status has reported them stopped since.
    pub started_here: bool,
    /// The vehicle was armed since the start sequence began.
    pub was_armed: bool,
    /// The present state has lasted for the settling time.
    pub settled: bool,
    /// The present state has lasted for the longest time of a sequence.
    pub timed_out: bool,
}

/// Transition from one state to another, taken when its condition holds.
struct MotorTransition {
    from: MotorState,
    to: MotorState,
    when: fn(&MotorConditions) -> bool,
}

/// All transitions; the first whose condition holds is taken.
const TRANSITIONS: [MotorTransition; 14] = {
    use MotorState::{Inhibited, Off, Running, Starting, Stopping};
    use MotorTransition as T;
    [
        // After silence in flight the daemon must first command "disarmed": it may only have been suspended.
        T { from: Inhibited, to: Off, when: |c| c.idle && (c.disarmed || !c.started_here) },
        // Motors that still run from before the state was `Inhibited`, or, under an operator's stop, any motors that run.
        T {
            from: Off,
            to: Stopping,
            when: |c| (c.started_here || c.operator_stop) && c.rest_over && c.armed,
        },
        T { from: Off, to: Running, when: |c| c.requested && c.running },
        T { from: Off, to: Starting, when: |c| c.requested && (c.stopped || c.armed) },
        // An operator or a long silence withdrew the request; a late command does not. The toggle may have taken effect and must be undone.
        T { from: Starting, to: Stopping, when: |c| c.disarmed || c.daemon_silent.is_some() },
        // The pilot, or the vehicle itself, has disarmed it while it spooled up.
        T { from: Starting, to: Inhibited, when: |c| c.was_armed && c.stopped },
        T { from: Starting, to: Running, when: |c| c.running },
        T { from: Starting, to: Inhibited, when: |c| c.timed_out },
        // The pilot may have stopped the motors: they are not restarted without an operator's command.
        T { from: Running, to: Inhibited, when: |c| c.stopped && c.requested },
        T { from: Running, to: Off, when: |c| c.stopped },
        T { from: Running, to: Inhibited, when: |c| c.daemon_silent.is_some() },
        T { from: Running, to: Stopping, when: |c| c.rest_over && c.armed },
        T { from: Stopping, to: Off, when: |c| c.stopped && c.settled },
        T { from: Stopping, to: Inhibited, when: |c| c.timed_out },
    ]
};

/// Event of the state machine, for the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorEvent {
    /// The start sequence begins.
    Starting,
    /// The motors run.
    Running,
    /// The stop sequence begins.
    Stopping,
    /// The motors have stopped.
    Stopped,
    /// The start sequence had no effect, or the vehicle was disarmed during it.
    StartFailed,
    /// The stop sequence had no effect.
    StopFailed,
    /// The motors stopped while a flight was requested.
    StoppedInFlight,
    /// The daemon's commands ended while the motors ran, this time ago.
    DaemonSilent(Span),
    /// A pilot or the vehicle itself has control of motors that run.
    ControlTaken,
    /// An operator's stop is not sent, because a pilot or the vehicle itself has control.
    StopWithheld,
}

/// State machine of the motors.
#[derive(Clone, Copy, Debug)]
pub struct MotorSequencer {
    state: MotorState,
    since: Time,
    longest: Span,
    /// Time after the last toggle of a start sequence within which the motors may begin to run, or be reported running.
    takes_effect: Span,
    started_here: bool,
    /// Last step in a start sequence, until the motors run or are known to have stayed off.
    started_at: Option<Time>,
    /// Whether the last sequence stops motors that the bridge did not start.
    stops_others: bool,
}

impl MotorSequencer {
    /// State machine in state `Inhibited` at `now`; its sequences last at most `longest`, and a report is at most `status_age` old.
    pub fn new(now: Time, longest: Span, status_age: Span) -> Self {
        Self {
            state: MotorState::Inhibited,
            since: now,
            longest,
            takes_effect: SETTLING_TIME + status_age,
            started_here: false,
            started_at: None,
            stops_others: false,
        }
    }

    /// The present state.
    pub fn state(&self) -> MotorState {
        self.state
    }

    /// Sets the state `Inhibited`.
    pub fn inhibit(&mut self, now: Time) {
        (self.state, self.since) = (MotorState::Inhibited, now);
    }

    /// Sets the state `Inhibited`, and leaves the motors alone: another has control.
    pub fn release(&mut self, now: Time) {
        self.inhibit(now);
        (self.started_here, self.started_at) = (false, None);
    }

    /// Whether the last sequence stops motors that the bridge did not start.
    pub fn stops_others(&self) -> bool {
        self.stops_others
    }

    /// Whether the motors may still begin to run because of a start sequence that has ended.
    pub fn may_start(&self) -> bool {
        self.started_at.is_some()
    }

    /// Whether the motors may run because of what the bridge sent.
    pub fn may_run(&self) -> bool {
        self.started_here
            || self.may_start()
            || !matches!(self.state, MotorState::Inhibited | MotorState::Off)
    }

    /// Makes the transition whose condition holds at `now`, if any; returns the event to be logged. Sets the last three fields of
    /// `conditions` itself.
    pub fn step(&mut self, now: Time, conditions: MotorConditions) -> Option<MotorEvent> {
        let lasted = now.since(self.since);
        if self.state == MotorState::Starting {
            self.started_at = Some(now);
        }
        self.started_here |= self.may_start() && conditions.armed;
        let was_armed = self.state == MotorState::Starting && self.started_here;
        self.started_here &= !conditions.stopped;
        // Without a report, a pilot may have started motors that run later.
        let longest = if conditions.stopped { Span::ZERO } else { self.longest };
        let may_start = |at: &Time| now.since(*at) < self.takes_effect + longest;
        self.started_at = self.started_at.filter(|at| !conditions.armed && may_start(at));
        let conditions = MotorConditions {
            started_here: self.started_here,
            was_armed,
            settled: lasted >= SETTLING_TIME,
            timed_out: lasted >= self.longest,
            ..conditions
        };
        let holds = |t: &&MotorTransition| t.from == self.state && (t.when)(&conditions);
        let transition = TRANSITIONS.iter().find(holds)?;
        (self.state, self.since) = (transition.to, now);
        self.stops_others = match (transition.from, transition.to) {
            (MotorState::Off, MotorState::Stopping) => !self.started_here,
            (_, MotorState::Starting | MotorState::Running) => false,
            _ => self.stops_others,
        };
        let event = event(transition, &conditions);
        match event {
            Some(MotorEvent::Running) => self.started_here = true,
            // One attempt and one line in the log; a stop of an operator is tried until it has effect.
            Some(MotorEvent::StopFailed) => self.started_here = false,
            _ => {}
        }
        event
    }
}

/// Event of a transition that was taken.
fn event(transition: &MotorTransition, conditions: &MotorConditions) -> Option<MotorEvent> {
    use MotorState::{Inhibited, Running, Starting, Stopping};
    match (transition.from, transition.to) {
        (_, Starting) => Some(MotorEvent::Starting),
        (_, Running) => Some(MotorEvent::Running),
        (_, Stopping) => Some(MotorEvent::Stopping),
        (Starting, Inhibited) => Some(MotorEvent::StartFailed),
        (Stopping, Inhibited) => Some(MotorEvent::StopFailed),
        (Running, Inhibited) => Some(
            conditions.daemon_silent.map_or(MotorEvent::StoppedInFlight, MotorEvent::DaemonSilent),
        ),
        (Inhibited, _) => None,
        _ => Some(MotorEvent::Stopped),
    }
}

#[cfg(test)]
mod tests;
