//! The limits of the supervisor's table, each in a flight in virtual time.

use super::common::flight::{Flight, set};
use super::common::{Bench, LAWS, REAL, still};
use nalgebra::Vector3;
use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState, VehicleRefusal};
use oqtal_bus::message::{CommandV1, ControlRequestV1, PoseV1, VehicleV1};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::text::LongText;
use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_daemon::LiveSettings;

/// Time until `state` with good poses \[ms\].
fn until(flight: &mut Flight, state: SafetyState) -> i64 {
    flight.until(state, Some).nanos() / 1_000_000
}

#[test]
fn f38_a_vehicle_that_tips_is_stopped_within_half_a_second() {
    for rate in [Vector3::x() * 5.0, Vector3::y() * -9.0, Vector3::new(14.0, 3.0, 0.0)] {
        let mut flight = Flight::hovering(&[]);
        flight.tumble = rate;
        while flight.tilt_deg() < 60.0 {
            flight.run(1);
        }
        let since = flight.bench.now;
        while flight.is_powered() {
            flight.run(1);
            assert!(flight.bench.now.since(since) <= Span::from_millis(500), "{rate:?}");
        }
        assert_eq!(flight.state(), SafetyState::Stop);
    }
}

#[test]
fn f38_a_vehicle_that_turns_over_slowly_enough_to_be_admitted_is_stopped_for_its_tilt() {
    // A rotation that no command demands would be found first.
    let alone = [set("safety.consistency-limit=1e6"), set("safety.probe-yaw-deg=0")];
    for rate in [2.6, 3.0, 3.4] {
        let mut flight = Flight::hovering(&alone);
        flight.tumble = Vector3::x() * rate;
        while flight.is_powered() {
            flight.run(1);
        }
        assert_eq!((flight.state(), flight.cause()), (SafetyState::Stop, Cause::Tilt), "{rate}");
    }
}

#[test]
fn f38_a_tilted_vehicle_is_reported() {
    let mut flight = Flight::hovering(&[set("safety.tilt-warning-deg=5.0")]);
    flight.wind = Vector3::x() * 1.2;
    until(&mut flight, SafetyState::Degraded);
    assert_eq!(flight.cause(), Cause::Tilt);
    flight.wind = Vector3::zeros();
    until(&mut flight, SafetyState::Nominal);
}

#[test]
fn f39_a_vehicle_that_lies_on_the_floor_with_thrust_is_stopped() {
    // Its loops never ask for a thrust that must lift it.
    let mut flight = Flight::hovering(&[set("position.vertical-acceleration-limit-m-s2=3.0")]);
    flight.lift = 0.0;
    while flight.motion.position.z > 0.0 {
        flight.run(1);
        // It falls on soft ground, and nothing noticed the fall.
        flight.motion.velocity.z = flight.motion.velocity.z.max(-0.6);
    }
    let waited = until(&mut flight, SafetyState::Stop);
    assert!(waited <= 2200, "{waited} ms");
    assert_eq!(flight.cause(), Cause::Crash);
}

#[test]
fn f40_a_vehicle_that_full_thrust_does_not_lift_is_stopped_on_the_floor() {
    let mut flight = Flight::new(&[]);
    flight.lift = 0.5;
    flight.run(60);
    let waited = until(&mut flight, SafetyState::Stop);
    assert!(waited <= 4000, "{waited} ms");
    assert_eq!(flight.cause(), Cause::NoLift);
    assert_eq!(flight.motion.position.z, 0.0);
    flight.lift = 1.0;
    flight.run(60);
    flight.bench.cycle.request(flight.bench.now, OperatorCommand::Arm);
    flight.run(300);
    assert!(flight.motion.position.z > 0.5, "the next flight: {:?}", flight.cause());
}

#[test]
fn f41_a_landing_that_does_not_end_is_ended() {
    let mut flight =
        Flight::hovering(&[set("fence.z-m=[-0.5, 500.0]"), set("safety.speed-limit-m-s=500.0")]);
    // An updraught that carries the vehicle under half of the least thrust.
    flight.wind = Vector3::z() * 7.5;
    flight.bench.cycle.request(flight.bench.now, OperatorCommand::Land);
    let waited = until(&mut flight, SafetyState::Stop);
    assert_eq!(flight.cause(), Cause::Landing);
    assert!(waited <= 6000 + 8000, "{waited} ms");
}

#[test]
fn f41_a_landing_on_something_that_is_higher_than_the_start_ends_in_good_order() {
    let mut flight = Flight::hovering(&[]);
    flight.floor = 0.4;
    flight.bench.cycle.request(flight.bench.now, OperatorCommand::Land);
    while flight.bench.mode() != Some(Mode::Disarmed) {
        flight.run(1);
        assert_eq!(flight.state(), SafetyState::Nominal, "{}", flight.cause());
    }
    assert_eq!(flight.motion.position.z, 0.4);
}

#[test]
fn f41_a_vehicle_stronger_than_configured_sinks_to_the_floor() {
    for law in LAWS {
        let mut flight =
            Flight::hovering_anywhere(&[set(&format!("control.controller={law:?}"))], 1.5);
        flight.bench.cycle.request(flight.bench.now, OperatorCommand::Land);
        while flight.bench.mode() != Some(Mode::Disarmed) {
            flight.run(1);
            assert_eq!(flight.state(), SafetyState::Nominal, "{law}: {}", flight.cause());
            assert!(flight.motion.velocity.z > -0.8, "{law}: {:?}", flight.motion);
        }
        assert!(flight.motion.position.z < 0.05, "{law}: {:?}", flight.motion);
    }
}

#[test]
fn f42_a_vehicle_that_sinks_under_full_thrust_lands() {
    let mut flight = Flight::hovering(&[set("trajectory.height-m=1.0")]);
    flight.lift = 0.66;
    let told = until(&mut flight, SafetyState::Degraded);
    assert_eq!(flight.cause(), Cause::NoLift);
    let waited = told + until(&mut flight, SafetyState::Land);
    assert_eq!(flight.cause(), Cause::NoLift);
    assert!(waited <= 2500, "{waited} ms");
    assert!(flight.motion.position.z > 0.0);
}

#[test]
fn f43_a_vehicle_that_is_too_fast_lands_at_once() {
    let mut flight = Flight::hovering(&[
        set("fence.x-m=[-500.0, 500.0]"),
        set("safety.speed-limit-m-s=2.0"),
        set("safety.tracking-limit-m=500.0"),
    ]);
    flight.wind = Vector3::x() * 6.0;
    while flight.motion.velocity.norm() < 2.0 {
        flight.run(1);
    }
    let waited = until(&mut flight, SafetyState::Land);
    assert_eq!(flight.cause(), Cause::Speed);
    assert!(waited <= 250, "{waited} ms");
}

#[test]
fn f43_a_vehicle_that_climbs_too_fast_lands() {
    let mut flight = Flight::hovering(&[
        set("fence.z-m=[-0.5, 500.0]"),
        set("safety.speed-limit-m-s=2.0"),
        set("safety.tracking-limit-m=500.0"),
    ]);
    flight.wind = Vector3::z() * 12.0;
    until(&mut flight, SafetyState::Land);
    assert_eq!(flight.cause(), Cause::Speed);
}

#[test]
fn f44_a_vehicle_that_stays_far_from_its_reference_lands() {
    let mut flight =
        Flight::hovering(&[set("fence.x-m=[-500.0, 500.0]"), set("safety.speed-limit-m-s=500.0")]);
    flight.wind = Vector3::x() * 3.2;
    while flight.motion.position.x < 1.5 {
        flight.run(1);
    }
    let told = until(&mut flight, SafetyState::Degraded);
    assert_eq!(flight.cause(), Cause::Tracking);
    assert!((800..=1200).contains(&told), "{told} ms");
    let waited = told + until(&mut flight, SafetyState::Land);
    assert_eq!(flight.cause(), Cause::Tracking);
    assert!((2800..=3200).contains(&waited), "{waited} ms");
}

#[test]
fn f45_f46_an_empty_battery_and_a_bad_link_end_the_flight_and_poor_ones_are_reported() {
    for (volts, quality, state, cause) in [
        (9.5, 1.0, SafetyState::Land, Cause::Battery),
        (10.0, 1.0, SafetyState::Degraded, Cause::Battery),
        (11.1, 0.05, SafetyState::Land, Cause::Link),
        (11.1, 0.4, SafetyState::Degraded, Cause::Link),
    ] {
        let mut flight = Flight::hovering(&[]);
        (flight.bench.vehicle.battery_v, flight.bench.vehicle.link_quality) = (volts, quality);
        let waited = until(&mut flight, state);
        assert!((2000..=2060).contains(&waited), "{cause}: {waited} ms");
        assert_eq!(flight.cause(), cause);
    }
    let mut flight = Flight::hovering(&[]);
    (flight.bench.vehicle.battery_v, flight.bench.vehicle.link_quality) = (f64::NAN, f64::NAN);
    flight.run(300);
    assert_eq!(flight.state(), SafetyState::Nominal, "an unknown number exceeds no limit");
}

#[test]
fn f04_poses_that_grow_old_are_reported_and_then_end_the_flight() {
    let mut flight = Flight::hovering(&[]);
    flight.bench.latency = Span::from_millis(55);
    let waited = until(&mut flight, SafetyState::Degraded);
    assert!(waited <= 300, "{waited} ms");
    assert_eq!(flight.cause(), Cause::PosesLate);
    flight.bench.latency = Span::from_millis(70);
    let waited = until(&mut flight, SafetyState::Land);
    assert!(waited <= 600, "{waited} ms");
    assert_eq!(flight.cause(), Cause::PosesLate);
}

#[test]
fn f11_a_loss_of_more_than_one_frame_in_twenty_is_reported() {
    let mut flight = Flight::hovering(&[]);
    let mut frame = 0;
    let waited = flight.until(SafetyState::Degraded, |pose| {
        frame += 1;
        (frame % 10 > 0).then_some(pose)
    });
    assert_eq!(flight.cause(), Cause::PosesLost);
    assert!(waited <= Span::from_millis(6000), "{waited:?}");
    let waited = until(&mut flight, SafetyState::Nominal);
    assert!(waited <= 6000, "{waited} ms");
}

#[test]
fn f22_three_late_ticks_in_a_row_are_reported() {
    let mut bench = Bench::flying(&[]);
    let mut tick = |late: i64| {
        bench.compute = Span::from_millis(late);
        bench.show(still(bench.frame));
        (bench.state().unwrap(), bench.cycle.telemetry().cause)
    };
    for late in [20, 20, 20] {
        assert_eq!(tick(late).0, SafetyState::Nominal);
    }
    assert_eq!(tick(0), (SafetyState::Degraded, Cause::Overrun.code()));
    assert_eq!((0..70).map(|_| tick(0).0).last(), Some(SafetyState::Nominal));
}

/// The turns themselves are late: each finds a pose that was published just now.
#[test]
fn f22_late_turns_on_recent_poses_are_reported() {
    let mut bench = Bench::flying(&[]);
    let mut tick = |late: i64| {
        bench.now = bench.now + Span::from_millis(late);
        bench.show(still(bench.frame));
        (bench.state().unwrap(), bench.cycle.telemetry().deadline_misses)
    };
    // Two and a half periods after the last tick are a period after the deadline.
    for tick_of in 0..9 {
        assert_eq!(tick(24), (SafetyState::Nominal, 0), "{tick_of}");
    }
    for missed in 1..=3 {
        assert_eq!(tick(26), (SafetyState::Nominal, missed));
    }
    assert_eq!(tick(0), (SafetyState::Degraded, 3));
    assert_eq!(bench.cycle.telemetry().cause, Cause::Overrun.code());
}

#[test]
fn f31_another_configuration_is_reported_in_flight() {
    let mut flight = Flight::hovering(&[]);
    flight.bench.cycle.notice_configurations(true);
    flight.run(1);
    assert_eq!((flight.state(), flight.cause()), (SafetyState::Degraded, Cause::Configuration));
    flight.bench.cycle.notice_configurations(false);
    flight.run(1);
    assert_eq!(flight.state(), SafetyState::Nominal);
}

/// The reasons against arming for a vehicle on the floor in `pose`.
fn refusal(bench: &mut Bench, pose: impl Fn(u64) -> PoseV1) -> Vec<ArmingObstacle> {
    for _ in 0..40 {
        bench.show(pose(bench.frame));
    }
    let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
    assert_eq!(response.answer, Answer::Refused.code());
    bench.cycle.request(bench.now, OperatorCommand::Fly);
    for _ in 0..10 {
        assert_eq!(bench.show(pose(bench.frame)).unwrap().command, CommandV1::default());
    }
    ArmingObstacles::from_bits(response.obstacles).iter().collect()
}

#[test]
fn arming_reports_every_reason_against_it_at_once() {
    use ArmingObstacle as O;
    let mut bench = Bench::new(&[set("safety.arming-z-m=[-0.1, 0.2]")]);
    bench.vehicle = REAL;
    (bench.vehicle.battery_v, bench.vehicle.stopped) = (9.0, 1);
    bench.cycle.notice_configurations(true);
    let held = |frame: u64| PoseV1 {
        position: [20.0 + 0.01 * frame as f64, 0.0, 0.8],
        attitude: [0.3, 0.0, 0.0, 0.91_f64.sqrt()],
        simulated: 1,
        ..still(frame)
    };
    let reasons = [
        O::Moving,
        O::Tilted,
        O::OffFloor,
        O::BatteryLow,
        O::EmulatedPoses,
        O::OutsideFence,
        O::Configuration,
        O::Stopped,
    ];
    assert_eq!(refusal(&mut bench, held), reasons);
}

#[test]
fn a_flight_does_not_begin_at_an_outlier_nor_where_its_path_leaves_the_fence() {
    let mut bench = Bench::new(&[]);
    let mostly = |frame: u64| {
        let offset = if frame.is_multiple_of(4) { 0.06 } else { 0.0 };
        PoseV1 { position: [offset, 0.0, 0.0], ..still(frame) }
    };
    bench.cycle.request(bench.now, OperatorCommand::Fly);
    while bench.cycle.telemetry().mission_s.is_nan() {
        bench.show(mostly(bench.frame));
    }
    assert_ne!((bench.frame - 1) % 4, 0, "at an outlier");
    let mut bench = Bench::new(&[]);
    let at_the_edge = |frame| PoseV1 { position: [6.9, 0.0, 0.0], ..still(frame) };
    assert_eq!(refusal(&mut bench, at_the_edge), [ArmingObstacle::PathOutsideFence]);
    // A trajectory that is changed on the ground is the one that is checked.
    let small = [set("trajectory.square.side-m=0.4")];
    let mut bench = Bench::new(&small);
    let settings = LiveSettings::new(&Config::from_settings(&small).unwrap(), &[]);
    let text = LongText::new("trajectory.square.side-m=1.3");
    let request = ControlRequestV1 { text, ..ControlRequestV1::of(OperatorCommand::Set) };
    let mut prepared = settings.prepare(OperatorCommand::Set, &request).unwrap();
    bench.cycle.change(bench.now, &mut prepared.change);
    assert_eq!(refusal(&mut bench, at_the_edge), [ArmingObstacle::PathOutsideFence]);
}

#[test]
fn f72_a_real_vehicle_without_a_time_out_of_its_own_is_armed_only_where_that_is_allowed() {
    for (limit_ms, time_out_s, is_armed) in [
        ("1000", 0.0, false),
        ("1000", f64::NAN, false),
        ("1000", f64::from(1.0_f32), true),
        ("1000", 1.01, false),
        ("100", f64::from(0.1_f32), true),
        ("100", 0.5, false),
        ("inf", 0.0, true),
    ] {
        let mut bench = Bench::new(&[set(&format!("safety.vehicle-time-out-ms={limit_ms}"))]);
        bench.vehicle = VehicleV1 { time_out_s, ..REAL };
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
        let told: Vec<_> = ArmingObstacles::from_bits(response.obstacles).iter().collect();
        let reasons = if is_armed { vec![] } else { vec![ArmingObstacle::NoTimeOut] };
        assert_eq!(told, reasons, "{limit_ms} ms, {time_out_s} s");
    }
}

#[test]
fn f66_a_vehicle_that_is_locked_or_not_set_up_is_refused_with_that_reason() {
    for (refusal, obstacle) in [
        (VehicleRefusal::Locked, ArmingObstacle::Locked),
        (VehicleRefusal::NotSetUp, ArmingObstacle::NotSetUp),
    ] {
        let mut bench = Bench::new(&[]);
        bench.vehicle = VehicleV1 { refusal: refusal.code(), time_out_s: 0.0, ..REAL };
        if refusal == VehicleRefusal::Locked {
            bench.vehicle.time_out_s = 0.5;
        }
        for _ in 0..20 {
            bench.show(still(bench.frame));
        }
        let response = bench.cycle.request(bench.now, OperatorCommand::Arm);
        let told: Vec<_> = ArmingObstacles::from_bits(response.obstacles).iter().collect();
        assert_eq!(told, [obstacle]);
    }
}
