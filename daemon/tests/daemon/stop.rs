//! An operator's stop at the daemon: seen by the loop itself, without its background thread.

use super::common::{Bench, FRAME, REAL, still};
use super::vehicle::arming_itself;
use oqtal_bus::code::{Actuation, Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::memory::MemoryBus;
use oqtal_bus::message::VehicleV1;
use oqtal_bus::time::Span;
use oqtal_bus::topic::{COMMAND, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_daemon::{CacheWarmup, DaemonPorts, DaemonTurn, LawPort, loop_handoff};
use oqtal_runtime::turn::step;

#[test]
fn f15_the_tick_after_a_stop_commands_disarmed_and_the_state_is_latched() {
    let bench = Bench::flying(&[]);
    let bus = MemoryBus::new();
    let stop = bus.stop_switch().unwrap();
    let mut commands = bus.observer(&COMMAND).unwrap();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut turn = DaemonTurn {
        ports: DaemonPorts::open(&bus).unwrap(),
        cycle: bench.cycle,
        warmup: CacheWarmup::never(),
        handle: loop_handoff().0,
        law: LawPort::default(),
    };
    let now = turn.cycle.next_event();
    step(&mut turn, now).unwrap();
    assert_eq!(commands.latest().unwrap().unwrap().1.actuation, Actuation::Sticks.code());
    let number = stop.raise();
    assert!(!stop.report(number).daemon_obeys);
    let now = turn.cycle.next_event();
    step(&mut turn, now).unwrap();
    assert_eq!(commands.latest().unwrap().unwrap().1.actuation, Actuation::Disarmed.code());
    assert!(stop.report(number).daemon_obeys);
    for _ in 0..5 {
        let now = turn.cycle.next_event();
        step(&mut turn, now).unwrap();
        let (_, tick) = telemetry.latest().unwrap().unwrap();
        assert_eq!((tick.mode, tick.state), (Mode::Disarmed.code(), SafetyState::Stop.code()));
        assert_eq!(tick.cause, Cause::Operator.code());
    }
}

#[test]
fn a_vehicle_that_reports_a_stop_ends_the_flight_and_is_not_armed() {
    let mut bench = Bench::flying(&[]);
    bench.vehicle = VehicleV1 { stopped: 1, ..bench.vehicle };
    bench.miss();
    bench.miss();
    assert_eq!((bench.state(), bench.mode()), (Some(SafetyState::Stop), Some(Mode::Disarmed)));
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    let refusal = bench.cycle.request(bench.now + FRAME, OperatorCommand::Arm);
    assert_eq!(refusal.cause, Cause::Operator.code());
    bench.vehicle = VehicleV1 { stopped: 0, ..bench.vehicle };
    bench.show(still(bench.frame));
    bench.cycle.request(bench.now + FRAME, OperatorCommand::Arm);
    bench.show(still(bench.frame));
    assert_eq!(bench.mode(), Some(Mode::Flying));
}

/// `oqtal daemon run` leaves the flight marker at its end if this is so.
#[test]
fn a_daemon_awaits_an_arm_from_a_stop_until_the_next_flight_begins() {
    let mut bench = arming_itself(1);
    let show = |bench: &mut Bench| {
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
    };
    show(&mut bench);
    assert!(bench.mode() == Some(Mode::Flying) && !bench.cycle.awaits_arm());
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    assert!(bench.cycle.awaits_arm(), "before a tick has executed the stop");
    show(&mut bench);
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.cycle.request(bench.now, OperatorCommand::Land);
    show(&mut bench);
    assert!(bench.mode() == Some(Mode::Disarmed) && bench.cycle.awaits_arm(), "called off");
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    show(&mut bench);
    assert!(bench.mode() == Some(Mode::Flying) && !bench.cycle.awaits_arm());
    // The daemon's own stop: without poses.
    for _ in 0..60 {
        bench.miss();
    }
    assert!(bench.state() == Some(SafetyState::Stop) && bench.cycle.awaits_arm());
    // A daemon that stays at its start, since one before it was stopped.
    let mut bench = arming_itself(1);
    bench.cycle.cancel_automatic(false);
    show(&mut bench);
    assert!(bench.mode() == Some(Mode::Disarmed) && bench.cycle.awaits_arm());
}

/// Its operator was told that the flight did not begin.
#[test]
fn a_daemon_that_was_suspended_after_an_accepted_arm_does_not_take_off() {
    for (pause_ms, mode) in
        [(100, Mode::Flying), (400, Mode::Disarmed), (3_600_000, Mode::Disarmed)]
    {
        let mut bench = Bench::new(&[]);
        bench.vehicle = REAL;
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
        assert_eq!(response.answer, Answer::Accepted.code());
        bench.now = bench.now + Span::from_millis(pause_ms);
        for _ in 0..3 {
            bench.show(still(bench.frame));
        }
        assert_eq!(bench.mode(), Some(mode), "{pause_ms} ms");
    }
}

/// A vehicle that moves in the tick after an accepted arm does not take off, and what stopped it before remains the cause.
#[test]
fn f33_a_stop_lasts_until_a_flight_begins() {
    for begins in [true, false] {
        let mut bench = Bench::flying(&[]);
        bench.cycle.request(bench.now, OperatorCommand::Stop);
        for _ in 0..60 {
            bench.show(still(bench.frame));
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
        assert_eq!(response.answer, Answer::Accepted.code());
        let mut pose = still(bench.frame);
        pose.position[0] += if begins { 0.0 } else { 0.03 };
        bench.show(pose);
        let expected = if begins {
            (Some(Mode::Flying), Some(SafetyState::Nominal))
        } else {
            (Some(Mode::Disarmed), Some(SafetyState::Stop))
        };
        assert_eq!((bench.mode(), bench.state()), expected);
    }
}
