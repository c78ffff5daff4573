//! Level and descend: vehicles with their own attitude loop, without poses, in virtual time.

use super::common::LAWS;
use super::common::flight::{Flight, moved, relabelled, set};
use nalgebra::Vector3;
use oqtal_bus::code::{Actuation, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{CommandV1, PoseV1};
use oqtal_bus::time::Span;
use oqtal_config::Setting;

/// A vehicle that holds its attitude and hovers at one metre.
fn hovering(settings: &[Setting]) -> Flight {
    Flight::hovering(&[settings, &[set("vehicle.interface=\"attitude\"")]].concat())
}

/// Flies without poses until `state`; time until then \[ms\].
fn blind_until(flight: &mut Flight, state: SafetyState) -> i64 {
    flight.until(state, |_| None).nanos() / 1_000_000
}

fn is_level(command: &CommandV1) -> bool {
    command.actuation == Actuation::Attitude.code()
        && command.sticks == [0.0; 3]
        && command.attitude[0].hypot(command.attitude[1]) < 1e-12
        // At the heading that the vehicle had.
        && command.attitude[2].abs() < 0.01
}

#[test]
fn f48_a_blind_vehicle_is_level_and_sinks_to_the_floor_and_its_motors_stop() {
    for law in LAWS {
        let law_set = set(&format!("control.controller={law:?}"));
        let mut flight = hovering(&[law_set, set("safety.probe-yaw-deg=0")]);
        let waited = blind_until(&mut flight, SafetyState::Descend);
        assert!(waited <= 275, "{law}: {waited} ms");
        assert_eq!(flight.cause(), Cause::NoPose);
        let since = flight.bench.now;
        while flight.state() == SafetyState::Descend {
            assert!(is_level(&flight.last_command), "{law}: {:?}", flight.last_command);
            assert!(flight.last_command.thrust > 0.0 && flight.tilt_deg() < 20.0, "{law}");
            assert!(flight.motion.velocity.z > -2.0, "{law}: {:?}", flight.motion);
            flight.frame(|_| None);
        }
        let sank = flight.bench.now.since(since);
        assert_eq!(flight.state(), SafetyState::Stop, "{law}");
        assert!(flight.motion.position.z < 0.1, "{law}: at {} m", flight.motion.position.z);
        assert!(sank < Span::from_millis(2500), "{law}: {sank:?}");
        flight.run(60);
        assert_eq!(flight.state(), SafetyState::Stop, "{law}: latched");
    }
}

/// The adaptation moves the correction from the estimated acceleration into the model.
#[test]
fn f48_a_vehicle_of_another_thrust_sinks_once_it_has_been_adapted_to() {
    for (lift, law) in [0.75, 1.3].into_iter().flat_map(|lift| LAWS.map(|law| (lift, law))) {
        let law_set = set(&format!("control.controller={law:?}"));
        let settings =
            [law_set, set("control.stack=\"predictive\""), set("trajectory.settle-s=60")];
        let mut flight = hovering(&settings);
        flight.lift = lift;
        flight.run(1500);
        blind_until(&mut flight, SafetyState::Descend);
        while flight.state() == SafetyState::Descend {
            let up_m_s = flight.motion.velocity.z;
            assert!((-2.0..0.2).contains(&up_m_s), "{law}, {lift}: {up_m_s} m/s");
            flight.frame(|_| None);
        }
        assert!(flight.motion.position.z < 0.15, "{law}, {lift}: {:?}", flight.motion.position);
    }
}

#[test]
fn f48_a_descent_ends_after_any_prediction() {
    let mut flight = hovering(&[set("safety.descend-ms=700")]);
    // So strong a lift that the vehicle climbs.
    flight.lift = 1.3;
    let waited = blind_until(&mut flight, SafetyState::Stop);
    assert!((940..=990).contains(&waited), "{waited} ms");
    let mut flight = hovering(&[set("safety.descend-ms=0")]);
    let waited = blind_until(&mut flight, SafetyState::Stop);
    assert!(waited <= 275, "none asked for: {waited} ms");
}

#[test]
fn f48_a_vehicle_on_the_floor_and_one_without_an_attitude_loop_stop_at_once() {
    let mut flight = Flight::new(&[set("vehicle.interface=\"attitude\"")]);
    flight.run(20);
    assert!(flight.motion.position.z < 0.05, "{:?}", flight.motion);
    assert_eq!(blind_until(&mut flight, SafetyState::Stop), 250);
    let mut flight = Flight::hovering(&[]);
    blind_until(&mut flight, SafetyState::Stop);
    assert_eq!(flight.bench.cycle.telemetry().cause, Cause::NoPose.code());
}

#[test]
fn f48_poses_that_come_back_end_the_descent_in_a_landing_where_the_vehicle_is() {
    for (law, lands) in LAWS.iter().flat_map(|law| [(law, false), (law, true)]) {
        let mut flight = hovering(&[set(&format!("control.controller={law:?}"))]);
        flight.wind = Vector3::new(0.3, -0.2, 0.0);
        flight.run(120);
        if lands {
            flight.bench.cycle.request(flight.bench.now, OperatorCommand::Land);
            flight.run(20);
        }
        blind_until(&mut flight, SafetyState::Descend);
        for _ in 0..24 {
            flight.frame(|_| None);
        }
        let seen_at = flight.motion.position;
        let waited = flight.until(SafetyState::Land, Some);
        assert!(waited <= Span::from_millis(101), "{law}: {waited:?}");
        while flight.bench.cycle.telemetry().mission_s.is_finite() {
            flight.run(1);
            assert!(flight.motion.position.z < seen_at.z + 0.1, "{law}: {:?}", flight.motion);
            assert!((flight.motion.position - seen_at).xy().norm() < 0.8, "{law}");
        }
        assert_ne!(flight.state(), SafetyState::Stop, "{law}: {}", flight.cause());
        assert!(flight.motion.position.z < 0.05, "{law}");
    }
}

#[test]
fn f48_markers_that_were_exchanged_are_not_admitted_in_a_descent() {
    for degrees in [180.0, 90.0, -60.0] {
        for gap in [0, 20, 60] {
            let mut flight = hovering(&[set("trajectory.height-m=1.0")]);
            for _ in 0..gap {
                flight.frame(|_| None);
            }
            while flight.state() != SafetyState::Stop {
                flight.frame(|pose| Some(relabelled(pose, degrees)));
                let telemetry = flight.bench.cycle.telemetry();
                assert_eq!(telemetry.fresh, 0, "{degrees} deg after {gap} frames");
            }
            let is_told = [Cause::Relabel, Cause::Jump].contains(&flight.cause());
            assert!(is_told, "{degrees} deg after {gap} frames: {}", flight.cause());
        }
    }
}

#[test]
fn f48_a_vehicle_that_a_gust_moved_unseen_is_admitted_when_it_is_seen_again() {
    for gap in [24, 36, 48] {
        let mut flight = hovering(&[]);
        flight.wind = Vector3::new(0.6, 0.3, 0.0);
        for _ in 0..8 {
            flight.frame(|_| None);
        }
        flight.wind = Vector3::zeros();
        for _ in 8..gap {
            flight.frame(|_| None);
        }
        flight.until(SafetyState::Land, Some);
        while flight.bench.mode() != Some(Mode::Disarmed) {
            flight.run(1);
            assert_eq!(flight.state(), SafetyState::Land, "{gap}: {}", flight.cause());
        }
        assert!(flight.motion.position.z < 0.05, "{gap}");
    }
}

/// Whether the vehicle lands on poses of another body, made by `change`, after `gap` frames of the descent.
fn lands_on(gap: usize, change: impl Fn(PoseV1) -> PoseV1) -> bool {
    let mut flight = hovering(&[]);
    for _ in 0..gap {
        flight.frame(|_| None);
    }
    let mut seen = 0;
    while flight.bench.mode() != Some(Mode::Disarmed) {
        flight.frame(|pose| Some(change(pose)));
        seen += u32::from(flight.bench.cycle.telemetry().fresh);
    }
    flight.state() != SafetyState::Stop || seen > 8
}

#[test]
fn f48_a_body_that_is_off_by_little_is_not_flown_on_after_a_descent() {
    for gap in [20, 36, 50] {
        for degrees in [8.0, -15.0, 25.0] {
            assert!(!lands_on(gap, |pose| relabelled(pose, degrees)), "{degrees} deg, {gap}");
        }
        for metres in [0.15, 0.4, -1.0] {
            let offset = Vector3::new(metres, 0.3 * metres, 0.0);
            assert!(!lands_on(gap, |pose| moved(pose, offset)), "{metres} m, {gap}");
        }
    }
}
