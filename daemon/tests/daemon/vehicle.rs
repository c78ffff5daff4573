//! Which flights begin and end because of what the vehicle says of itself.

use super::common::flight::set;
use super::common::{Bench, FRAME, LAWS, REAL, WELL, still};
use oqtal_bus::code::{
    Actuation, Answer, Cause, ControlHolder, EstimatorState, Mode, OperatorCommand, SafetyState,
};
use oqtal_bus::message::{CommandV1, Header, PoseV1, VehicleV1};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::time::Span;
use oqtal_config::Setting;
use oqtal_daemon::{FirstFlight, Tick};

#[test]
fn arming_is_refused_while_the_vehicle_is_silent_and_a_flight_that_waits_waits_for_it() {
    for (silent, link) in [(true, 1), (false, 0)] {
        let mut bench = Bench::new(&[]);
        (bench.silent, bench.vehicle.link) = (silent, link);
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        assert_eq!(bench.state(), Some(SafetyState::Coast));
        assert_eq!(bench.cycle.telemetry().cause, Cause::NoVehicle.code());
        let refusal = bench.cycle.request(bench.now, OperatorCommand::Arm);
        assert_eq!(
            (refusal.answer, refusal.cause),
            (Answer::Refused.code(), Cause::NoVehicle.code())
        );
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        for _ in 0..20 {
            assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
        }
        assert_eq!(bench.mode(), Some(Mode::Waiting));
        (bench.silent, bench.vehicle) = (false, WELL);
        bench.show(still(bench.frame));
        bench.show(still(bench.frame));
        assert_eq!(bench.mode(), Some(Mode::Flying));
    }
}

#[test]
fn f18_a_vehicle_that_falls_silent_in_flight_is_stopped_within_its_limit() {
    for (silent, link) in [(true, 1), (false, 0)] {
        let mut bench = Bench::flying(&[]);
        (bench.silent, bench.vehicle.link) = (silent, link);
        let since = bench.now;
        while bench.state() != Some(SafetyState::Stop) {
            bench.show(still(bench.frame)).unwrap();
            assert!(bench.now.since(since) <= Span::from_millis(500) + FRAME);
        }
        assert!(
            bench.now.since(since) > Span::from_millis(500),
            "a short silence is flown through"
        );
        assert_eq!(bench.cycle.telemetry().cause, Cause::NoVehicle.code());
        let refusal = bench.cycle.request(bench.now, OperatorCommand::Arm);
        assert_eq!(refusal.cause, Cause::NoVehicle.code());
        (bench.silent, bench.vehicle) = (false, WELL);
        for _ in 0..10 {
            assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
        }
        assert_eq!(bench.state(), Some(SafetyState::Stop), "latched");
        bench.cycle.request(bench.now, OperatorCommand::Arm);
        bench.show(still(bench.frame));
        assert_eq!(bench.mode(), Some(Mode::Flying));
    }
}

#[test]
fn f57_control_that_another_takes_is_left_to_it_in_the_same_tick_until_an_operator_arms_again() {
    let mut bench = Bench::flying(&[]);
    assert_ne!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    bench.vehicle.control = ControlHolder::Another.code();
    bench.show(still(bench.frame));
    // The message about the vehicle comes with the command before: it is read in the next tick.
    for _ in 0..20 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
        assert_eq!(bench.state(), Some(SafetyState::Stop));
        assert_eq!(bench.cycle.telemetry().cause, Cause::ControlTaken.code());
    }
    let refusal = bench.cycle.request(bench.now, OperatorCommand::Arm);
    assert_eq!(refusal.cause, Cause::ControlTaken.code());
    bench.vehicle.control = ControlHolder::Nobody.code();
    for _ in 0..20 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
    }
    assert_eq!(bench.state(), Some(SafetyState::Stop), "latched");
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.show(still(bench.frame));
    assert_eq!(bench.mode(), Some(Mode::Flying));
}

#[test]
fn a_vehicle_that_does_not_know_its_own_motion_is_not_armed() {
    let mut bench = Bench::new(&[]);
    bench.vehicle.estimator = EstimatorState::NotReady.code();
    for _ in 0..20 {
        bench.show(still(bench.frame));
    }
    let refusal = bench.cycle.request(bench.now, OperatorCommand::Arm);
    assert_eq!(refusal.cause, Cause::NotReady.code());
}

#[test]
fn a_flight_begins_when_the_motors_run() {
    for law in LAWS {
        let mut bench = Bench::new(&[Setting::flag("test", "control.controller", law)]);
        for _ in 0..10 {
            bench.show(still(bench.frame));
        }
        bench.vehicle = VehicleV1 { starting: 1, ..REAL };
        bench.cycle.request(bench.now, OperatorCommand::Arm);
        bench.show(still(bench.frame));
        for _ in 0..120 {
            let Tick { command, .. } = bench.show(still(bench.frame)).unwrap();
            assert_eq!(command.actuation, Actuation::Sticks.code(), "{law}");
            assert_eq!((command.thrust, command.sticks), (0.0, [0.0; 3]), "{law}");
            assert_eq!(bench.cycle.telemetry().mission_s, 0.0, "{law}");
        }
        (bench.vehicle.starting, bench.vehicle.armed) = (0, 1);
        bench.show(still(bench.frame));
        assert!(bench.cycle.telemetry().mission_s < 0.02, "{law}");
        let thrust = (0..10).map(|_| bench.show(still(bench.frame)).unwrap().command.thrust);
        assert!(thrust.fold(0.0, f64::max) > 0.0, "{law}");
    }
}

#[test]
fn f36_motors_that_stand_in_flight_end_it_be_they_started_again_or_not() {
    for starting in [0, 1] {
        let mut bench = Bench::flying(&[]);
        bench.vehicle.armed = 1;
        bench.show(still(bench.frame));
        (bench.vehicle.armed, bench.vehicle.starting) = (0, starting);
        let since = bench.now;
        while bench.state() != Some(SafetyState::Stop) {
            bench.show(still(bench.frame)).unwrap();
            assert!(bench.now.since(since) <= Span::from_millis(500) + FRAME);
        }
        assert_eq!(bench.cycle.telemetry().cause, Cause::MotorsNotRunning.code());
    }
}

#[test]
fn motors_that_never_run_can_be_called_off() {
    for command in [OperatorCommand::Land, OperatorCommand::Disarm, OperatorCommand::Stop] {
        let mut bench = Bench::new(&[]);
        bench.vehicle = VehicleV1 { starting: 1, ..REAL };
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        assert_eq!(bench.mode(), Some(Mode::Flying));
        bench.cycle.request(bench.now, command);
        assert_eq!(
            bench.show(still(bench.frame)).unwrap().command,
            CommandV1::default(),
            "{command}"
        );
        assert_eq!(bench.mode(), Some(Mode::Disarmed));
    }
}

/// A real vehicle that is commanded to fly: cameras present, motors not running.
fn taking_off() -> Bench {
    let mut bench = Bench::new(&[]);
    bench.vehicle = REAL;
    for _ in 0..10 {
        bench.show(still(bench.frame));
    }
    bench.cycle.request(bench.now, OperatorCommand::Arm);
    bench.show(still(bench.frame));
    assert_eq!(bench.mode(), Some(Mode::Flying));
    bench
}

/// Frames until Stop; before it the flight must not have got anywhere.
fn until_stop(bench: &mut Bench) -> Span {
    let since = bench.now;
    while bench.state() != Some(SafetyState::Stop) {
        assert_eq!(bench.cycle.telemetry().thrust, 0.0);
        bench.show(still(bench.frame)).unwrap();
        let elapsed_s = bench.cycle.telemetry().mission_s;
        assert!(elapsed_s == 0.0 || elapsed_s.is_nan(), "flown in the head for {elapsed_s} s");
        assert!(bench.now.since(since) < Span::from_millis(10_000));
    }
    assert_eq!(bench.cycle.telemetry().cause, Cause::MotorsNotRunning.code());
    assert_eq!(bench.mode(), Some(Mode::Disarmed));
    bench.now.since(since)
}

#[test]
fn f36_a_flight_whose_motors_are_never_started_is_stopped_at_its_beginning() {
    let limit = Span::from_millis(3500);
    let waited = until_stop(&mut taking_off());
    assert!(
        (limit - FRAME.scaled(2.0)..=limit + FRAME.scaled(2.0)).contains(&waited),
        "{waited:?}"
    );
}

#[test]
fn f36_a_start_of_motors_that_was_given_up_stops_the_flight_at_once() {
    for starting in [1, 30, 180] {
        let mut bench = taking_off();
        bench.vehicle.starting = 1;
        for _ in 0..starting {
            bench.show(still(bench.frame));
            assert_eq!(bench.mode(), Some(Mode::Flying));
        }
        bench.vehicle.starting = 0;
        assert!(until_stop(&mut bench) <= FRAME.scaled(2.01), "after {starting} frames");
        bench.cycle.request(bench.now, OperatorCommand::Arm);
        bench.show(still(bench.frame));
        assert_eq!(bench.mode(), Some(Mode::Flying), "an operator may try again");
    }
}

#[test]
fn f36_a_start_of_motors_that_never_ends_stops_the_flight() {
    let mut bench = taking_off();
    bench.vehicle.starting = 1;
    assert!(until_stop(&mut bench) > Span::from_millis(3000));
}

#[test]
fn a_simulated_vehicle_has_no_motors_to_wait_for() {
    let mut bench = Bench::flying(&[]);
    for _ in 0..60 {
        bench.show(still(bench.frame));
    }
    assert_eq!(bench.state(), Some(SafetyState::Nominal));
    assert!(bench.cycle.telemetry().mission_s > 0.9);
}

pub fn arming_itself(simulated: u8) -> Bench {
    let mut bench = Bench::new(&[Setting::flag("test", "safety.arm-at-start", true)]);
    bench.vehicle.simulated = simulated;
    bench
}

#[test]
fn a_daemon_that_arms_at_start_flies_once_and_only_a_simulated_vehicle() {
    for (simulated, outcome, mode) in
        [(1, FirstFlight::Started, Mode::Flying), (0, FirstFlight::Refused, Mode::Disarmed)]
    {
        let mut bench = arming_itself(simulated);
        assert_eq!(bench.cycle.first_flight(), FirstFlight::Pending);
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        assert_eq!(bench.cycle.first_flight(), outcome);
        assert_eq!(bench.mode(), Some(mode));
        bench.cycle.request(bench.now, OperatorCommand::Stop);
        bench.vehicle.simulated = 1;
        for _ in 0..20 {
            assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
        }
    }
}

#[test]
fn a_flight_at_start_is_called_off_at_any_instant_until_an_operator_arms() {
    use OperatorCommand::{Arm, Disarm, Fly, Land, Stop};
    let expecting = || {
        let mut bench = Bench::new(&[]);
        bench.cycle.expect_flight();
        bench
    };
    let waiting = || {
        let mut bench = expecting();
        assert_eq!(bench.cycle.request(bench.now, Fly).answer, Answer::Accepted.code());
        bench
    };
    for begin in [&|| arming_itself(1), &expecting as &dyn Fn() -> Bench, &waiting] {
        for command in [Land, Disarm, Stop] {
            let mut bench = begin();
            for (command, is_refused) in
                [(command, false), (command, command == Land), (Land, true)]
            {
                let response = bench.cycle.request(bench.now, command);
                assert_eq!(response.answer == Answer::Refused.code(), is_refused, "{command}");
                assert_eq!(response.mode, Mode::Disarmed.code());
            }
            let refused = bench.cycle.request(bench.now, Fly);
            assert_eq!(refused.answer, Answer::Refused.code(), "{command}");
            assert_eq!(refused.cause, Cause::Operator.code());
            stays_on_the_ground(&mut bench);
            assert_eq!(bench.cycle.first_flight(), FirstFlight::CalledOff);
            let armed = bench.cycle.request(bench.now, Arm);
            assert_eq!(armed.answer, Answer::Accepted.code(), "{command}");
            bench.show(still(bench.frame));
            assert_eq!(bench.mode(), Some(Mode::Flying));
        }
    }
    // Where no flight is about to begin, nothing is called off.
    let mut bench = Bench::new(&[]);
    let refused = bench.cycle.request(bench.now, Land);
    assert_eq!((refused.answer, refused.cause), (Answer::Refused.code(), Cause::WrongMode.code()));
    assert_eq!(bench.cycle.request(bench.now, Fly).answer, Answer::Accepted.code());
}

/// A vehicle without cameras yet.
fn blind(bench: &mut Bench) {
    for _ in 0..30 {
        assert_eq!(bench.miss().unwrap().command, CommandV1::default());
    }
}

/// The cameras come, and nothing flies.
fn stays_on_the_ground(bench: &mut Bench) {
    for _ in 0..60 {
        assert_eq!(bench.show(still(bench.frame)).unwrap().command, CommandV1::default());
        assert_eq!(bench.mode(), Some(Mode::Disarmed));
    }
}

#[test]
fn f18_a_vehicle_swapped_while_a_flight_at_start_waits_does_not_fly_by_itself() {
    for (first, second) in [(WELL, REAL), (REAL, WELL)] {
        let mut bench = arming_itself(first.simulated);
        blind(&mut bench);
        (bench.vehicle, bench.source) = (second, 2);
        blind(&mut bench);
        stays_on_the_ground(&mut bench);
        assert_eq!(bench.cycle.first_flight(), FirstFlight::Refused);
    }
}

#[test]
fn f18_the_tick_that_takes_off_by_itself_asks_whether_the_vehicle_is_simulated() {
    let mut bench = arming_itself(1);
    for _ in 0..5 {
        bench.show(still(bench.frame));
    }
    let header = Header { source: 2, ..Header::default() };
    bench.cycle.receive_vehicle(bench.now, &header, &REAL);
    (bench.vehicle, bench.source) = (REAL, 2);
    stays_on_the_ground(&mut bench);
}

#[test]
fn f18_a_requested_flight_is_not_flown_with_another_vehicle() {
    for (first, second) in [(WELL, REAL), (REAL, WELL), (REAL, REAL)] {
        let mut bench = Bench::new(&[]);
        bench.vehicle = first;
        blind(&mut bench);
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        blind(&mut bench);
        assert_eq!(bench.mode(), Some(Mode::Waiting));
        (bench.vehicle, bench.source) = (second, 2);
        blind(&mut bench);
        assert_eq!(bench.state(), Some(SafetyState::Stop));
        assert_eq!(bench.cycle.telemetry().cause, Cause::NoVehicle.code());
        stays_on_the_ground(&mut bench);
        bench.cycle.request(bench.now, OperatorCommand::Fly);
        bench.show(still(bench.frame));
        assert_eq!(bench.mode(), Some(Mode::Flying), "asked for again");
    }
}

#[test]
fn a_real_vehicle_flies_on_emulated_poses_only_where_that_is_allowed() {
    for (allowed, reasons) in [(false, vec![ArmingObstacle::EmulatedPoses]), (true, vec![])] {
        let mut bench = Bench::new(&[set(&format!("safety.allow-emulated-poses={allowed}"))]);
        bench.vehicle = REAL;
        for _ in 0..20 {
            bench.show(PoseV1 { simulated: 1, ..still(bench.frame) });
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
        let told: Vec<_> = ArmingObstacles::from_bits(response.obstacles).iter().collect();
        assert_eq!(told, reasons);
        let answer = if allowed { Answer::Accepted } else { Answer::Refused };
        assert_eq!(response.answer, answer.code());
    }
}

/// A flight would be held until they stand, or flown on motors that are about to.
#[test]
fn no_flight_begins_while_the_motors_are_being_stopped() {
    let mut bench = Bench::new(&[]);
    for (armed, starting, is_stopping) in [(1, 1, true), (0, 1, false), (1, 0, false)] {
        bench.vehicle = VehicleV1 { armed, starting, ..REAL };
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Status);
        let told: Vec<_> = ArmingObstacles::from_bits(response.obstacles).iter().collect();
        assert_eq!(told == [ArmingObstacle::MotorsStopping], is_stopping, "{told:?}");
    }
}
