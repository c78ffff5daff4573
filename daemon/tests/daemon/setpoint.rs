//! Absurd references in flights in virtual time: a step of the yaw that turns the vehicle round at once.

use super::common::flight::{Flight, set};
use nalgebra::Vector3;
use oqtal_bus::code::{Cause, Mode, OperatorCommand, SafetyState};

/// A flight with a reversed reference for 5 s, with its warnings.
fn turned_round(settings: &[&str]) -> Flight {
    let step = ["trajectory.kind=\"step\"", "trajectory.step.axis=\"yaw\""];
    let angle = ["trajectory.step.angle-deg=180.0", "trajectory.step.hold-s=5.0"];
    let settings: Vec<_> =
        [&step, &angle, settings].concat().iter().map(|text| set(text)).collect();
    let mut flight = Flight::new(&settings);
    flight.until(SafetyState::Nominal, Some);
    flight.until(SafetyState::Degraded, Some);
    assert_eq!(flight.cause(), Cause::Setpoint);
    flight
}

/// Heading of the vehicle \[deg\].
fn heading_deg(flight: &Flight) -> f64 {
    let forward = flight.motion.attitude.to_world(&Vector3::x());
    forward.y.atan2(forward.x).to_degrees()
}

/// The reference that is flown \[m, world\].
fn reference(flight: &Flight) -> Vector3<f64> {
    Vector3::from(flight.bench.cycle.telemetry().reference_position)
}

/// Flies to the end: the vehicle lands, at the heading that it had.
fn assert_lands(mut flight: Flight) {
    let at = flight.motion.position;
    while flight.bench.mode() != Some(Mode::Disarmed) {
        flight.run(1);
        assert_ne!(flight.state(), SafetyState::Stop, "{}", flight.cause());
        assert!(heading_deg(&flight).abs() < 5.0, "{} deg", heading_deg(&flight));
        let flown = reference(&flight);
        assert!((flight.motion.position - flown).norm() < 0.2, "{:?} {flown:?}", flight.motion);
    }
    assert!(flight.motion.position.z < 0.05, "{:?}", flight.motion);
    assert!((flight.motion.position - at).xy().norm() < 0.1, "{:?}", flight.motion);
}

#[test]
fn f35_a_landing_asked_for_while_the_reference_is_refused_is_flown() {
    let mut flight = turned_round(&[]);
    flight.run(20);
    flight.bench.cycle.request(flight.bench.now, OperatorCommand::Land);
    flight.run(1);
    assert_eq!(flight.bench.mode(), Some(Mode::Landing));
    flight.run(60);
    assert_eq!(flight.state(), SafetyState::Nominal, "{}", flight.cause());
    assert_lands(flight);
}

#[test]
fn f35_a_reference_that_stays_turned_is_flown_with_the_last_heading_down_to_the_floor() {
    assert_lands(turned_round(&["trajectory.duration-s=2.0"]));
}

#[test]
fn f35_a_hold_while_the_reference_is_refused_keeps_the_last_heading() {
    let mut flight = turned_round(&["fence.x-m=[-2.0, 2.0]", "fence.soft-margin-m=1.7"]);
    flight.wind = Vector3::x() * 3.5;
    flight.until(SafetyState::Hold, Some);
    flight.wind = Vector3::zeros();
    flight.run(10);
    let held = reference(&flight);
    assert!((0.1..0.3).contains(&held.x), "held at the soft border: {held:?}");
    assert_eq!((flight.state(), flight.cause()), (SafetyState::Hold, Cause::Fence));
    flight.until(SafetyState::Nominal, Some);
    assert!(heading_deg(&flight).abs() < 5.0, "{} deg", heading_deg(&flight));
}
