//! Tests of the state machine of the motors.

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

const START: Time = Time::VIRTUAL_START;
const STATUS_AGE: Span = Span::from_millis(375);

fn new() -> MotorSequencer {
    MotorSequencer::new(START, LONGEST, STATUS_AGE)
}

fn motors(state: MotorState, conditions: &MotorConditions) -> MotorSequencer {
    let started_here = conditions.started_here;
    MotorSequencer { state, started_here, ..new() }
}

fn after(state: MotorState, millis: i64, conditions: MotorConditions) -> MotorState {
    let mut motors = motors(state, &conditions);
    motors.step(START + Span::from_millis(millis), conditions);
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
    let requested = MotorConditions { armed: true, ..REQUESTED };
    let spooling = MotorConditions { armed: true, disarmed: true, ..NONE };
    let ours = MotorConditions { started_here: true, rest_over: true, ..spooling };
    assert_eq!([requested, spooling].map(|c| after(Starting, 1, c)), [Starting, Stopping]);
    assert_eq!([after(Stopping, 2999, spooling), after(Off, 1, ours)], [Stopping; 2]);
    let stopped = MotorConditions { stopped: true, started_here: true, ..REQUESTED };
    assert_eq!(after(Starting, 1, stopped), Inhibited, "disarmed by its pilot");
}

#[test]
fn a_start_is_not_withdrawn_by_a_pause_of_the_daemon() {
    let silent = MotorConditions { daemon_silent: Some(LONGEST), ..STOPPED };
    let disarmed = MotorConditions { disarmed: true, ..STOPPED };
    let next = [STOPPED, silent, disarmed].map(|conditions| after(Starting, 1, conditions));
    assert_eq!(next, [Starting, Stopping, Stopping]);
}

/// The last command of a start has effect, or is reported to have, after the sequence was given up.
#[test]
fn motors_that_start_late_are_those_of_the_bridge() {
    let waiting = MotorConditions { requested: true, ..STOPPED };
    for (late_ms, is_ours) in [(100, true), (800, true), (1000, false)] {
        let mut motors = motors(Starting, &waiting);
        assert_eq!(motors.step(START + LONGEST, waiting), Some(MotorEvent::StartFailed));
        let later = |ms| START + LONGEST + Span::from_millis(ms);
        motors.step(later(late_ms - 50), STOPPED);
        assert_eq!(motors.may_start(), is_ours, "{late_ms}");
        let disarmed = MotorConditions { idle: true, disarmed: true, rest_over: true, ..RUNNING };
        motors.step(later(late_ms), disarmed);
        assert_eq!(motors.may_run(), is_ours, "{late_ms}");
        motors.step(later(late_ms + 20), disarmed);
        assert_eq!(motors.state() == Stopping, is_ours, "{late_ms}");
    }
    let mut silent = motors(Starting, &waiting);
    silent.step(START + LONGEST, waiting);
    silent.step(START + Span::from_millis(60_000), NONE);
    assert!(!silent.may_start(), "a pilot may have started what runs later");
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
    let mut now = START;
    let mut motors = new();
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
        let mut motors = motors(from, &conditions);
        (motors.step(START + LONGEST, conditions), motors.may_run())
    };
    let silent = MotorConditions { daemon_silent: Some(LONGEST), started_here: true, ..RUNNING };
    let ends = MotorConditions { rest_over: true, ..RUNNING };
    let waiting = MotorConditions { stopped: true, ..REQUESTED };
    let begun = MotorConditions { requested: true, ..RUNNING };
    for (from, conditions, event, may_run) in [
        (Inhibited, MotorConditions { idle: true, ..NONE }, None, false),
        (Off, waiting, Some(MotorEvent::Starting), true),
        (Starting, REQUESTED, Some(MotorEvent::StartFailed), true),
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
