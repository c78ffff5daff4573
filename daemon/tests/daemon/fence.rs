//! The fence, in flights in virtual time.

use super::common::flight::{Flight, set};
use nalgebra::Vector3;
use oqtal_bus::code::{Cause, SafetyState};
use oqtal_bus::time::Span;

#[test]
fn f37_the_hard_border_of_the_fence_is_not_crossed_under_power() {
    let polygon = "fence.polygon-m=[[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]";
    for fence in ["fence.x-m=[-2.0, 2.0]", polygon] {
        for acceleration in [3.0, 6.0, -6.0] {
            let mut flight = Flight::hovering(&[set(fence), set("fence.soft-margin-m=0.5")]);
            flight.wind = Vector3::x() * acceleration;
            while flight.state() != SafetyState::Stop || flight.is_powered() {
                flight.run(1);
                let x = flight.motion.position.x;
                assert!(x.abs() < 2.0 || !flight.is_powered(), "{fence}: {x} m under power");
            }
            assert_eq!(flight.cause(), Cause::Fence);
        }
    }
}

#[test]
fn f37_the_delay_of_the_radio_is_part_of_the_prediction() {
    let mut flight =
        Flight::hovering(&[set("fence.x-m=[-2.0, 2.0]"), set("vehicle.command-delay-ms=80")]);
    flight.bench.radio = Span::from_millis(80);
    flight.run(200);
    flight.wind = Vector3::x() * 6.0;
    while flight.state() != SafetyState::Stop || flight.is_powered() {
        flight.run(1);
        let x = flight.motion.position.x;
        assert!(x < 2.0 || !flight.is_powered(), "{x} m under power");
    }
    assert_eq!(flight.cause(), Cause::Fence);
}

#[test]
fn f47_outside_the_soft_border_the_vehicle_returns_and_holds() {
    let mut flight =
        Flight::hovering(&[set("fence.x-m=[-2.0, 2.0]"), set("fence.soft-margin-m=1.2")]);
    flight.wind = Vector3::x() * 3.5;
    flight.until(SafetyState::Hold, Some);
    assert_eq!(flight.cause(), Cause::Fence);
    // The soft border is at 0.8 m.
    let [held, ..] = flight.bench.cycle.telemetry().reference_position;
    assert!((0.75..=0.8).contains(&held), "held at {held} m");
    flight.wind = Vector3::zeros();
    flight.until(SafetyState::Nominal, Some);
    flight.run(300);
    assert!(flight.motion.position.xy().norm() < 0.1, "on with the mission");
}

/// Whatever a law does there: the wind pushes the vehicle to the soft border from both sides.
#[test]
fn f47_a_vehicle_that_swings_across_the_soft_border_is_landed_after_ten_seconds_of_hold() {
    let mut flight =
        Flight::hovering(&[set("fence.x-m=[-2.0, 2.0]"), set("fence.soft-margin-m=1.2")]);
    let (mut held, mut crossings, mut was_outside) = (0, 0, false);
    while flight.state() != SafetyState::Land {
        let is_outside = flight.motion.position.x > 0.8;
        crossings += u32::from(is_outside != was_outside);
        was_outside = is_outside;
        flight.wind = Vector3::x() * if is_outside { -1.0 } else { 3.0 };
        flight.run(1);
        held += u32::from(flight.state() == SafetyState::Hold);
        assert!(held <= 602, "{held} ticks of hold");
    }
    assert!(crossings > 4, "{crossings} crossings");
    assert_eq!(flight.cause(), Cause::HeldTooLong);
    flight.wind = Vector3::zeros();
    while flight.is_powered() {
        flight.run(1);
    }
    assert!(flight.motion.position.z < 0.05, "{:?}", flight.motion);
}
