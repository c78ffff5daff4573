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
    /// Zero set-point; a flight request has no effect until there has been none for a command timeout.
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
        // The request was withdrawn: the toggle may have taken effect already, and then must be undone.
        T { from: Starting, to: Stopping, when: |c| !c.requested },
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
    started_here: bool,
    /// Whether the last sequence stops motors that the bridge did not start.
    stops_others: bool,
}

impl MotorSequencer {
    /// State machine in state `Inhibited` at `now`; its sequences last at most `longest`.
    pub fn new(now: Time, longest: Span) -> Self {
        let state = MotorState::Inhibited;
        Self { state, since: now, longest, started_here: false, stops_others: false }
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
        self.started_here = false;
    }

    /// Whether the last sequence stops motors that the bridge did not start.
    pub fn stops_others(&self) -> bool {
        self.stops_others
    }

    /// Whether the motors may run because of what the bridge sent.
    pub fn may_run(&self) -> bool {
        self.started_here || !matches!(self.state, MotorState::Inhibited | MotorState::Off)
    }

    /// Makes the transition whose condition holds at `now`, if any; returns the event to be logged. Sets the last three fields of
    /// `conditions` itself.
    pub fn step(&mut self, now: Time, conditions: MotorConditions) -> Option<MotorEvent> {
        let lasted = now.since(self.since);
        self.started_here |= self.state == MotorState::Starting && conditions.armed;
        let was_armed = self.state == MotorState::Starting && self.started_here;
        self.started_here &= !conditions.stopped;
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
mod tests {
    use super::*;
    use MotorState::{Inhibited, Off, Running, Starting, Stopping};

    const LONGEST: Span = Span::from_millis(3000);
    const STATES: [MotorState; 5] = [Inhibited, Off, Starting, Running, Stopping];
    const NONE: MotorConditions = MotorConditions {
        requested: false,
        idle: false,
        disarmed: false,
        rest_over: false,
        running: false,
        armed: false,
        stopped: false,
        operator_stop: false,
        daemon_silent: None,
        started_here: false,
        was_armed: false,
        settled: false,
        timed_out: false,
    };
    const RUNNING: MotorConditions = MotorConditions { running: true, armed: true, ..NONE };
    const STOPPED: MotorConditions = MotorConditions { stopped: true, ..NONE };
    const REQUESTED: MotorConditions = MotorConditions { requested: true, ..NONE };

    fn after(state: MotorState, millis: i64, conditions: MotorConditions) -> MotorState {
        let (since, started_here) = (Time::VIRTUAL_START, conditions.started_here);
        let mut motors =
            MotorSequencer { state, started_here, ..MotorSequencer::new(since, LONGEST) };
        motors.step(since + Span::from_millis(millis), conditions);
        motors.state
    }

    fn all_conditions() -> impl Iterator<Item = MotorConditions> {
        (0..64_u8).map(|bits| {
            let on = |bit: u8| bits & (1 << bit) != 0;
            let (requested, running, stopped) = (on(0), on(3), on(4));
            let (idle, rest_over, armed) = (on(1), on(2), running || on(5));
            MotorConditions { requested, idle, rest_over, running, armed, stopped, ..NONE }
        })
    }

    #[test]
    fn a_flight_goes_round() {
        assert_eq!(after(Inhibited, 1, MotorConditions { idle: true, ..STOPPED }), Off);
        assert_eq!(after(Off, 1, MotorConditions { requested: true, ..STOPPED }), Starting);
        assert_eq!(after(Starting, 1, MotorConditions { requested: true, ..RUNNING }), Running);
        assert_eq!(after(Running, 1, RUNNING), Running, "not requested, but not for long");
        assert_eq!(after(Running, 1, MotorConditions { rest_over: true, ..RUNNING }), Stopping);
        assert_eq!(after(Stopping, 499, STOPPED), Stopping, "that status may be old");
        assert_eq!(after(Stopping, 500, STOPPED), Off);
    }

    #[test]
    fn motors_that_spool_up_are_stopped_when_the_request_is_withdrawn() {
        let spooling = MotorConditions { armed: true, ..NONE };
        let requested = MotorConditions { requested: true, ..spooling };
        let ours = MotorConditions { started_here: true, rest_over: true, ..spooling };
        assert_eq!([requested, spooling].map(|c| after(Starting, 1, c)), [Starting, Stopping]);
        assert_eq!([after(Stopping, 2999, spooling), after(Off, 1, ours)], [Stopping; 2]);
        let stopped = MotorConditions { stopped: true, started_here: true, ..REQUESTED };
        assert_eq!(after(Starting, 1, stopped), Inhibited, "disarmed by its pilot");
    }

    #[test]
    fn a_sequence_is_given_up() {
        assert_eq!(after(Starting, 2999, REQUESTED), Starting);
        assert_eq!(after(Starting, 3000, REQUESTED), Inhibited);
        assert_eq!(after(Stopping, 3000, NONE), Inhibited);
    }

    #[test]
    fn only_an_idle_daemon_ends_the_inhibition() {
        for conditions in all_conditions() {
            let is_off = after(Inhibited, 10_000, conditions) == Off;
            assert_eq!(is_off, conditions.idle, "{conditions:?}");
        }
    }

    #[test]
    fn without_a_fresh_status_no_sequence_begins_except_to_cancel_a_start() {
        for state in STATES {
            for conditions in all_conditions().filter(|c| !c.armed && !c.stopped) {
                let next = after(state, 10, conditions);
                let begun = next != state && matches!(next, Starting | Stopping);
                assert!(!begun || state == Starting, "{state:?} {conditions:?}");
            }
        }
    }

    #[test]
    fn motors_that_stopped_in_flight_are_not_started_again() {
        let stopped = MotorConditions { stopped: true, ..REQUESTED };
        assert_eq!(after(Running, 10, stopped), Inhibited);
        assert_eq!(after(Inhibited, 10, stopped), Inhibited);
    }

    #[test]
    fn a_daemon_that_fell_silent_must_be_disarmed_before_it_flies_on() {
        let run = MotorConditions { started_here: true, requested: true, ..RUNNING };
        let silent = MotorConditions { daemon_silent: Some(LONGEST), requested: false, ..run };
        assert_eq!(after(Running, 10, silent), Inhibited);
        assert_eq!(after(Inhibited, 10, run), Inhibited);
        let idle = MotorConditions { idle: true, requested: false, ..run };
        assert_eq!(after(Inhibited, 10, idle), Inhibited);
        let disarmed = MotorConditions { disarmed: true, rest_over: true, ..idle };
        assert_eq!(after(Inhibited, 10, disarmed), Off);
        assert_eq!(after(Off, 10, disarmed), Stopping);
    }

    #[test]
    fn motors_that_the_bridge_did_not_start_are_left_alone() {
        let by_hand = MotorConditions { idle: true, rest_over: true, ..RUNNING };
        assert_eq!(after(Inhibited, 10, by_hand), Off);
        assert_eq!(after(Off, 10_000, by_hand), Off);
    }

    #[test]
    fn motors_of_a_bridge_before_are_stopped_by_an_operator_until_it_has_effect() {
        let running = MotorConditions { idle: true, rest_over: true, ..RUNNING };
        let stop = MotorConditions { operator_stop: true, ..running };
        let mut now = Time::VIRTUAL_START;
        let mut motors = MotorSequencer::new(now, LONGEST);
        for _ in 0..3 {
            let states = [(); 3].map(|()| {
                now = now + LONGEST;
                motors.step(now, stop);
                motors.state
            });
            assert_eq!(states, [Off, Stopping, Inhibited], "the sequence has no effect");
        }
    }

    #[test]
    fn each_transition_is_logged_as_what_it_is() {
        let logged = |from: MotorState, conditions: MotorConditions| {
            let (since, started_here) = (Time::VIRTUAL_START, conditions.started_here);
            let new = MotorSequencer::new(since, LONGEST);
            let mut motors = MotorSequencer { state: from, started_here, ..new };
            (motors.step(since + LONGEST, conditions), motors.may_run())
        };
        let silent =
            MotorConditions { daemon_silent: Some(LONGEST), started_here: true, ..RUNNING };
        let ends = MotorConditions { rest_over: true, ..RUNNING };
        let waiting = MotorConditions { stopped: true, ..REQUESTED };
        let begun = MotorConditions { requested: true, ..RUNNING };
        for (from, conditions, event, may_run) in [
            (Inhibited, MotorConditions { idle: true, ..NONE }, None, false),
            (Off, waiting, Some(MotorEvent::Starting), true),
            (Starting, REQUESTED, Some(MotorEvent::StartFailed), false),
            (Starting, begun, Some(MotorEvent::Running), true),
            (Running, ends, Some(MotorEvent::Stopping), true),
            (Running, STOPPED, Some(MotorEvent::Stopped), false),
            (Running, silent, Some(MotorEvent::DaemonSilent(LONGEST)), true),
            (Running, waiting, Some(MotorEvent::StoppedInFlight), false),
            (Stopping, NONE, Some(MotorEvent::StopFailed), false),
        ] {
            assert_eq!(logged(from, conditions), (event, may_run), "{from:?} {conditions:?}");
        }
    }
}
