//! The gate on the innovation, in flights in virtual time.

use super::common::flight::{Flight, moved, relabelled, set};
use super::common::{FRAME, LAWS};
use nalgebra::Vector3;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::time::Span;

#[test]
fn f10_a_consistent_relabel_is_never_admitted_in_flight() {
    for degrees in [180.0, 90.0, -45.0] {
        for gap in [0, 4, 7] {
            let mut flight = Flight::hovering(&[]);
            let blind_since = flight.bench.now - flight.bench.latency;
            for _ in 0..gap {
                flight.frame(|_| None);
            }
            while flight.state() != SafetyState::Stop {
                flight.frame(|pose| Some(relabelled(pose, degrees)));
                let blind = flight.bench.now.since(blind_since);
                assert!(blind <= Span::from_millis(250) + FRAME.scaled(2.0), "{degrees} {gap}");
                assert_eq!(flight.bench.cycle.telemetry().fresh, 0, "admitted");
            }
            assert_eq!(flight.cause(), Cause::Relabel, "{degrees} deg after {gap} frames");
            flight.run(60);
            assert_eq!(flight.state(), SafetyState::Stop, "latched");
        }
    }
}

#[test]
fn f10_a_body_that_appears_elsewhere_is_not_admitted() {
    for offset in [0.06, 0.3, 2.0] {
        let mut flight = Flight::hovering(&[]);
        let waited =
            flight.until(SafetyState::Stop, |pose| Some(moved(pose, Vector3::x() * offset)));
        assert!(waited <= Span::from_millis(250) + FRAME.scaled(2.0), "{offset} m");
        assert_eq!(flight.cause(), Cause::Relabel, "{offset} m");
    }
}

/// Poses of another body agree with each other; these do not.
#[test]
fn f09_outliers_in_a_row_are_not_taken_for_another_body() {
    let mut flight = Flight::hovering(&[]);
    for k in 0..6_u32 {
        let angle = f64::from(k) * 2.4;
        let offset = Vector3::new(angle.cos(), angle.sin(), 0.0) * 0.5;
        flight.frame(|pose| Some(moved(pose, offset)));
        assert_ne!(flight.cause(), Cause::Relabel, "{k}");
        assert_eq!(flight.bench.cycle.telemetry().fresh, 0, "admitted");
    }
    flight.run(60);
    assert_eq!(flight.state(), SafetyState::Nominal);
}

#[test]
fn f09_outliers_are_refused_and_every_law_flies_on() {
    for law in LAWS {
        for distance in [0.05, 0.14, 1.0] {
            let mut flight = Flight::hovering(&[set(&format!("control.controller={law:?}"))]);
            for k in 0..300_u32 {
                let angle = f64::from(k) * 2.4;
                let offset = Vector3::new(angle.cos(), angle.sin(), 0.0) * distance;
                let is_wrong = k % 5 == 0 || k % 17 == 1;
                flight.frame(|pose| Some(if is_wrong { moved(pose, offset) } else { pose }));
                assert_ne!(
                    flight.state(),
                    SafetyState::Stop,
                    "{law} {distance} m: {}",
                    flight.cause()
                );
            }
            let error = (flight.motion.position - Vector3::z()).norm();
            assert!(error < 0.1, "{law} {distance} m: {error} m off");
        }
    }
}

#[test]
fn f03_a_source_without_noise_that_freezes_in_motion_counts_as_missing_after_a_few_frames() {
    let mut flight = Flight::new(&[]);
    flight.noise = 0.0;
    flight.run(80);
    assert!(flight.motion.velocity.z > 0.3, "{:?}", flight.motion);
    let mut frozen = None;
    let waited = flight.until(SafetyState::Coast, |pose| Some(*frozen.get_or_insert(pose)));
    assert_eq!(flight.cause(), Cause::Frozen);
    assert!(waited <= FRAME.scaled(9.0), "{waited:?}");
    let waited = flight.until(SafetyState::Stop, |pose| Some(*frozen.get_or_insert(pose)));
    assert!(waited <= Span::from_millis(250), "{waited:?}");
}

#[test]
fn f03_a_source_that_freezes_in_hover_or_at_take_off_is_noticed_before_the_vehicle_is_far() {
    let mut flight = Flight::hovering(&[]);
    flight.tumble = Vector3::new(0.02, -0.01, 0.0);
    flight.run(120);
    let mut frozen = None;
    let waited = flight.until(SafetyState::Stop, |pose| Some(*frozen.get_or_insert(pose)));
    assert_eq!(flight.cause(), Cause::Frozen);
    assert!(waited <= Span::from_millis(300), "{waited:?}");
    let off = (flight.motion.position - Vector3::z()).norm();
    assert!(off < 0.1, "{off} m off after {waited:?}");
    let mut flight = Flight::new(&[]);
    flight.run(20);
    let mut frozen = None;
    flight.until(SafetyState::Stop, |pose| Some(*frozen.get_or_insert(pose)));
    assert_eq!(flight.cause(), Cause::Frozen);
    assert!(flight.motion.position.z < 0.3, "climbed unseen to {} m", flight.motion.position.z);
}

#[test]
fn f03_a_source_without_noise_that_freezes_on_the_floor_or_in_a_turn_is_noticed() {
    let mut flight = Flight::new(&[]);
    flight.noise = 0.0;
    flight.run(20);
    assert!(flight.motion.position.z < 0.02, "{:?}", flight.motion);
    let mut frozen = None;
    flight.until(SafetyState::Stop, |pose| Some(*frozen.get_or_insert(pose)));
    assert_eq!(flight.cause(), Cause::Frozen);
    // A vehicle that is heavier than configured would stand under up to 1.35 times the weight.
    assert!(flight.motion.position.z < 1.2, "climbed unseen to {} m", flight.motion.position.z);
    let turn = ["trajectory.kind=\"step\"", "trajectory.step.axis=\"yaw\""];
    let angle = ["trajectory.step.angle-deg=90.0", "trajectory.step.hold-s=5.0"];
    let mut flight =
        Flight::new(&[turn, angle].as_flattened().iter().map(|text| set(text)).collect::<Vec<_>>());
    flight.noise = 0.0;
    while flight.motion.rate.z < 0.8 {
        flight.run(1);
    }
    let mut frozen = None;
    let waited = flight.until(SafetyState::Stop, |pose| Some(*frozen.get_or_insert(pose)));
    assert_eq!(flight.cause(), Cause::Frozen);
    assert!(waited <= Span::from_millis(450), "{waited:?}");
}

#[test]
fn perfect_and_coarse_poses_take_off_and_hover() {
    let rounded = |x: f64, quantum: f64| (x / quantum).round() * quantum;
    for quantum in [0.0, 1e-3] {
        let mut flight = Flight::new(&[set("trajectory.settle-s=60")]);
        flight.noise = 0.0;
        for k in 0..600 {
            assert_eq!(
                flight.bench.cycle.telemetry().poses_refused,
                0,
                "{quantum} m, frame {k}: {:?}",
                flight.motion
            );
            flight.frame(|mut pose| {
                if quantum > 0.0 {
                    pose.position = pose.position.map(|x| rounded(x, quantum));
                }
                Some(pose)
            });
        }
        assert_eq!(flight.state(), SafetyState::Nominal, "{}", flight.cause());
        assert_eq!(flight.bench.cycle.telemetry().poses_refused, 0, "{quantum}");
        assert!((flight.motion.position.z - 1.0).abs() < 0.05);
    }
}

#[test]
fn f01_a_gap_is_flown_on_the_predicted_motion_by_every_law() {
    for law in LAWS {
        let mut flight = Flight::new(&[set(&format!("control.controller={law:?}"))]);
        // In the middle of a corner of the square.
        flight.run(60 * 7);
        let mut commands = Vec::new();
        for _ in 0..5 {
            commands.push(flight.frame(|_| None).unwrap().command);
        }
        assert!(commands.windows(2).all(|pair| pair[0] != pair[1]), "{law}: held");
        flight.run(240);
        assert_eq!(flight.state(), SafetyState::Nominal, "{law}: {}", flight.cause());
        assert_eq!(flight.bench.mode(), Some(Mode::Flying));
        let reference = flight.bench.cycle.telemetry().reference_position;
        let error = (flight.motion.position - Vector3::from(reference)).norm();
        assert!(error < 0.15, "{law}: {error} m off");
    }
}

#[test]
fn wind_and_a_vehicle_that_differs_from_the_model_cause_no_refused_pose() {
    let causes = [
        (Vector3::x() * 6.0, 1.0),
        (Vector3::y() * -6.0, 1.0),
        (Vector3::zeros(), 0.75),
        (Vector3::zeros(), 1.3),
    ];
    for (law, (wind, lift)) in LAWS.iter().flat_map(|law| causes.map(|cause| (law, cause))) {
        let mut flight = Flight::new(&[
            set(&format!("control.controller={law:?}")),
            set("fence.x-m=[-500.0, 500.0]"),
            set("fence.y-m=[-500.0, 500.0]"),
            set("trajectory.settle-s=60"),
        ]);
        flight.lift = lift;
        flight.run(240);
        flight.wind = wind;
        flight.run(120);
        assert_eq!(flight.bench.cycle.telemetry().poses_refused, 0, "{law} {wind:?} {lift}");
    }
}
