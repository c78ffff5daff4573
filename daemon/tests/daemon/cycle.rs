//! The controller's turn of the loop with good, bad and invalid poses.

use super::common::{Bench, FRAME, LATENCY, LAWS, still};
use oqtal_bus::code::{Actuation, Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Setting;
use proptest::prelude::*;

fn assert_sane(command: &CommandV1) {
    let in_range = |value: &f64, low: f64| (low..=1.0).contains(value);
    assert!(command.sticks.iter().all(|stick| in_range(stick, -1.0)), "{command:?}");
    assert!(command.torque.iter().all(|torque| torque.is_finite()), "{command:?}");
    assert!(in_range(&command.thrust, 0.0), "{command:?}");
}

fn any_bits() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        Just(f64::NAN),
        Just(f64::INFINITY),
        -2.0..2.0f64,
    ]
}

fn any_pose() -> impl Strategy<Value = PoseV1> {
    let numbers = (prop::array::uniform3(any_bits()), prop::array::uniform4(any_bits()));
    (numbers, any::<u8>()).prop_map(|((position, attitude), tracked)| PoseV1 {
        position,
        attitude,
        tracked,
        ..PoseV1::default()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn f06_every_pose_gives_a_command_that_is_finite_and_in_range(
        poses in prop::collection::vec((any_pose(), any::<bool>()), 1..60),
        law in prop::sample::select(LAWS.to_vec()),
        vehicle in prop::sample::select(vec!["hummingbird", "spacecraft"]),
    ) {
        let mut bench = Bench::flying(&[
            Setting::flag("test", "control.controller", law),
            Setting::flag("test", "vehicle.preset", vehicle),
        ]);
        for (pose, absurd) in poses {
            let pose = if absurd { pose } else { still(bench.frame) };
            if let Some(tick) = bench.show(pose) {
                assert_sane(&tick.command);
            }
        }
    }

    #[test]
    fn f08_the_sign_of_a_quaternion_changes_no_command(
        flips in prop::collection::vec(any::<bool>(), 40),
        law in prop::sample::select(LAWS.to_vec()),
    ) {
        let settings = [Setting::flag("test", "control.controller", law)];
        let (mut plain, mut flipped) = (Bench::flying(&settings), Bench::flying(&settings));
        for flip in flips {
            let pose = still(plain.frame);
            let opposite = PoseV1 { attitude: pose.attitude.map(|x| -x), ..pose };
            let a = plain.show(pose).map(|tick| tick.command);
            let b = flipped.show(if flip { opposite } else { pose }).map(|tick| tick.command);
            prop_assert_eq!(a, b);
        }
    }
}

#[test]
fn the_vehicle_is_disarmed_until_a_flight_is_requested_and_poses_are_good() {
    let mut bench = Bench::new(&[]);
    for _ in 0..20 {
        let tick = bench.show(still(bench.frame)).expect("a tick on every pose");
        assert_eq!(tick.command.actuation, Actuation::Disarmed.code());
    }
    assert_eq!(
        bench.cycle.request(bench.now, OperatorCommand::Arm).answer,
        Answer::Accepted.code()
    );
    let tick = bench.show(still(bench.frame)).unwrap();
    assert_eq!(tick.command.actuation, Actuation::Sticks.code());
    assert!(tick.command.thrust > 0.0);
}

#[test]
fn arming_is_refused_before_enough_good_poses() {
    let mut bench = Bench::new(&[]);
    for _ in 0..5 {
        assert_eq!(
            bench.cycle.request(bench.now, OperatorCommand::Arm).answer,
            Answer::Refused.code()
        );
        bench.show(still(bench.frame));
    }
    bench.show(still(bench.frame));
    assert_eq!(
        bench.cycle.request(bench.now, OperatorCommand::Arm).answer,
        Answer::Accepted.code()
    );
}

#[test]
fn f01_missing_poses_coast_after_three_periods_on_the_prediction_and_then_on_the_last_command() {
    let mut bench = Bench::flying(&[]);
    bench.show(still(bench.frame)).unwrap();
    let seen = bench.now;
    bench.miss().expect("a tick at the deadline");
    assert_eq!(bench.state(), Some(SafetyState::Nominal), "one deadline may be missed");
    let mut held = bench.miss().expect("a tick at the second deadline");
    assert_eq!(bench.state(), Some(SafetyState::Coast));
    assert!(bench.now.since(seen) < FRAME.scaled(3.01));
    while bench.now.since(seen) < Span::from_millis(200) {
        let tick = bench.miss().unwrap();
        let predicted = bench.now.since(seen) <= Span::from_millis(150);
        assert_eq!(tick.command != held.command, predicted);
        held = tick;
    }
    bench.show(still(bench.frame));
    assert_eq!(bench.state(), Some(SafetyState::Coast));
    for _ in 0..5 {
        bench.show(still(bench.frame));
    }
    assert_eq!(bench.state(), Some(SafetyState::Nominal));
}

#[test]
fn f11_poses_that_come_irregularly_but_come_change_no_state() {
    let mut bench = Bench::flying(&[]);
    // Shorter than the time after which a vehicle that stands still under thrust is stopped, F40.
    for (k, millis) in
        [10, 20, 40, 30, 10, 10, 40, 40, 20, 3].into_iter().cycle().take(50).enumerate()
    {
        let arrival = bench.now + Span::from_millis(millis);
        while bench.cycle.next_event() < arrival {
            bench.now = bench.cycle.next_event();
            bench.cycle.step(bench.now, None);
            assert_eq!(bench.state(), Some(SafetyState::Nominal), "at pose {k}");
        }
        bench.now = arrival - FRAME;
        bench.show(still(bench.frame));
        assert_eq!(bench.state(), Some(SafetyState::Nominal), "at pose {k}");
    }
}

#[test]
fn a_pose_that_was_captured_later_than_now_is_refused() {
    let mut bench = Bench::flying(&[]);
    bench.latency = Span::from_millis(-5);
    bench.show(still(bench.frame));
    assert_eq!(bench.cycle.telemetry().poses_refused, 1);
    assert_eq!(bench.cycle.telemetry().fresh, 0);
}

#[test]
fn after_a_flight_nothing_is_commanded_any_more() {
    let mut bench = Bench::flying(&[]);
    bench.show(still(bench.frame));
    assert!(bench.cycle.telemetry().attitude_command[3].is_finite());
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    bench.show(still(bench.frame));
    let telemetry = bench.cycle.telemetry();
    let commands = telemetry.velocity_command.iter().chain(&telemetry.attitude_command);
    assert!(commands.into_iter().all(|number| number.is_nan()), "{telemetry:?}");
}

#[test]
fn f02_blindness_stops_within_its_limit_and_stays_stopped() {
    let mut bench = Bench::flying(&[]);
    let blind_since = bench.now - LATENCY;
    while bench.state() != Some(SafetyState::Stop) {
        let tick = bench.miss().unwrap();
        let blind = bench.now.since(blind_since);
        let late = Span::from_millis(250) + Span::from_millis(25);
        assert!(blind <= late, "still {:?} after {} ms", tick.command, blind.nanos() / 1_000_000);
    }
    for _ in 0..100 {
        let tick = bench.show(still(bench.frame)).unwrap();
        assert_eq!(tick.command, CommandV1::default());
    }
    assert_eq!(bench.mode(), Some(Mode::Disarmed));
    assert_eq!(bench.state(), Some(SafetyState::Stop));
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.show(still(bench.frame));
    assert_eq!(bench.state(), Some(SafetyState::Nominal), "an operator armed again");
}

#[test]
fn an_operator_stop_acts_with_the_next_tick_and_latches() {
    let mut bench = Bench::flying(&[]);
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    assert_eq!(bench.state(), Some(SafetyState::Stop));
}

#[test]
fn f22_a_pose_after_its_deadline_is_flown_on_at_once_and_commands_keep_the_time_of_their_wire() {
    for (wire_ms, at_once) in [(0, true), (1, true), (4, false), (300, false)] {
        let mut bench = Bench::flying(&[]);
        bench.vehicle.wire_ns = Span::from_millis(wire_ms).nanos();
        bench.miss().unwrap();
        let deadline = bench.now;
        // A frame arrives 2 ms after the deadline.
        bench.now = deadline + Span::from_millis(2) - FRAME;
        assert_eq!(bench.show(still(bench.frame)).is_some(), at_once, "wire {wire_ms} ms");
        if !at_once {
            let allowed = deadline + Span::from_millis(wire_ms).min(FRAME.scaled(0.5));
            assert_eq!(bench.cycle.next_event(), allowed, "the pose is not forgotten");
            assert!(bench.cycle.step(allowed, None).is_some());
        }
    }
}

/// Arrivals of the frames of a camera of `rate_hz`, which sends nothing for `stall` from the 20th frame on and then sends the last
/// `burst` of the frames that it held back: pairs of capture and arrival.
fn stalled_arrivals(start: Time, rate_hz: f64, stall: Span, burst: usize) -> Vec<(Time, Time)> {
    let frame = Span::period_of(rate_hz);
    let stalled_at = start + frame.scaled(20.0);
    let resumed_at = stalled_at + stall;
    let regular = (1..60).map(|k| start + frame.scaled(f64::from(k)));
    let (held, free): (Vec<_>, Vec<_>) =
        regular.partition(|&at| at >= stalled_at && at < resumed_at);
    let skipped = held.len().saturating_sub(burst);
    let sent =
        held.iter().skip(skipped).enumerate().map(|(k, &due)| {
            (due - LATENCY, resumed_at + Span::from_nanos(100_000).scaled(k as f64))
        });
    let mut all: Vec<_> = free.iter().map(|&due| (due - LATENCY, due)).chain(sent).collect();
    all.sort_by_key(|&(_, arrival)| arrival);
    all
}

#[test]
fn f22_after_any_stall_the_next_pose_is_flown_on_as_soon_as_it_arrives() {
    const LEAST: Span = Span::from_nanos(500_000);
    /// Older poses are refused.
    const MAX_AGE: Span = Span::from_millis(80);
    for rate_hz in [30.0, 60.0, 61.0, 240.0] {
        for (stall_ms, burst) in
            (1..=200).step_by(7).flat_map(|ms| [0, 1, 10].map(|burst| (ms, burst)))
        {
            let mut bench = Bench::flying(&[]);
            let stall = Span::from_millis(stall_ms);
            let arrivals = stalled_arrivals(bench.now, rate_hz, stall, burst);
            let resumed_at = bench.now + Span::period_of(rate_hz).scaled(20.0) + stall;
            let mut ticks = vec![bench.now];
            let mut first_after = None;
            for (captured_at, arrival) in arrivals {
                while bench.cycle.next_event() < arrival {
                    bench.now = bench.cycle.next_event();
                    let tick = bench.cycle.step(bench.now, None);
                    ticks.extend(bench.send(tick).map(|_| bench.now));
                }
                (bench.frame, bench.now) = (bench.frame + 1, arrival);
                let stamps =
                    Stamps { captured_at, pose_published_at: arrival, ..Stamps::default() };
                let header = Header { pose_sequence: bench.frame, stamps, ..Header::default() };
                let before = *ticks.last().unwrap();
                let tick = bench.cycle.step(arrival, Some(&(header, still(bench.frame))));
                ticks.extend(bench.send(tick).map(|_| arrival));
                let is_used = arrival.since(captured_at) < MAX_AGE;
                if is_used && arrival >= resumed_at && first_after.is_none() {
                    first_after = Some(arrival);
                    let due = arrival.max(before + LEAST);
                    let next = if tick.is_some() { arrival } else { bench.cycle.next_event() };
                    assert!(next <= due, "{rate_hz} Hz, {stall_ms} ms, burst {burst}");
                }
            }
            let closest = ticks.windows(2).map(|pair| pair[1].since(pair[0])).min().unwrap();
            assert!(closest >= LEAST, "{rate_hz} Hz, {stall_ms} ms, burst {burst}: {closest:?}");
        }
    }
}

#[test]
fn ticks_fall_in_step_with_poses_again_after_a_late_one() {
    for late_ms in 1..16 {
        let mut bench = Bench::flying(&[]);
        bench.miss().unwrap();
        bench.now = bench.now + Span::from_millis(late_ms) - FRAME;
        for pose in 0..10 {
            let tick = bench.show(still(bench.frame));
            assert!(tick.is_some(), "pose {pose}, the first {late_ms} ms late");
        }
    }
}

#[test]
fn a_recording_is_observed_and_only_a_stop_is_taken() {
    let mut bench = Bench::new(&[Setting::flag("test", "mocap.replay", "some.csv")]);
    for _ in 0..30 {
        let tick = bench.show(still(bench.frame)).unwrap();
        assert_eq!(tick.command, CommandV1::default());
    }
    assert!(bench.cycle.telemetry().thrust > 0.0, "what would have been sent is told");
    assert_eq!(bench.mode(), Some(Mode::Observing));
    use OperatorCommand::{Arm, Disarm, Fly, Land, Resume};
    for command in [Arm, Fly, Land, Disarm, Resume] {
        let refused = bench.cycle.request(bench.now, command);
        let (answer, cause) = (Answer::Refused.code(), Cause::ObservesOnly.code());
        assert_eq!((refused.answer, refused.cause), (answer, cause), "{command}");
        let obstacles = ArmingObstacles::from_bits(refused.obstacles);
        assert!(obstacles.iter().eq([ArmingObstacle::ObservesOnly]), "{obstacles}");
    }
    let stop = bench.cycle.request(bench.now, OperatorCommand::Stop);
    assert_eq!(stop.answer, Answer::Accepted.code());
    bench.show(still(bench.frame));
    assert_eq!(bench.mode(), Some(Mode::Observing));
    for _ in 0..30 {
        bench.miss();
    }
    assert_eq!(bench.state(), Some(SafetyState::Stop));
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    assert_eq!(bench.state(), Some(SafetyState::Nominal), "Stop does not latch");
}

#[test]
fn a_stop_while_waiting_calls_the_flight_off() {
    let mut bench = Bench::new(&[]);
    bench.cycle.request(bench.now, OperatorCommand::Fly);
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    for _ in 0..30 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    }
}

#[test]
fn a_stop_in_the_tick_of_an_arming_wins() {
    let mut bench = Bench::flying(&[]);
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.cycle.request(bench.now, OperatorCommand::Stop);
    for _ in 0..10 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    }
}

#[test]
fn a_landing_before_take_off_calls_the_flight_off() {
    let mut bench = Bench::new(&[]);
    bench.cycle.request(bench.now, OperatorCommand::Fly);
    assert_eq!(bench.cycle.request(bench.now, OperatorCommand::Land).answer, Answer::Done.code());
    for _ in 0..30 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    }
}

#[test]
fn arming_means_now_or_not_at_all() {
    let mut bench = Bench::new(&[]);
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.miss();
    bench.miss();
    for _ in 0..30 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    }
    assert_eq!(bench.mode(), Some(Mode::Disarmed));
}

#[test]
fn a_pose_from_the_future_is_refused_and_later_ones_are_accepted() {
    let mut bench = Bench::flying(&[]);
    let stamps = Stamps { captured_at: bench.now + Span::from_millis(5000), ..Stamps::default() };
    let header = Header { pose_sequence: bench.frame + 1, stamps, ..Header::default() };
    bench.cycle.step(bench.now, Some(&(header, still(1))));
    bench.show(still(bench.frame));
    assert_eq!(bench.state(), Some(SafetyState::Nominal));
}

#[test]
fn a_wrong_first_pose_does_not_keep_the_vehicle_on_the_ground() {
    let mut bench = Bench::new(&[]);
    bench.cycle.request(bench.now, OperatorCommand::Fly);
    bench.show(PoseV1 { position: [5.0, 0.0, 0.0], ..still(0) });
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    assert_eq!(bench.mode(), Some(Mode::Flying));
}
