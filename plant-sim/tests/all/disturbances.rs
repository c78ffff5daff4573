//! Disturbances in time: effect of each of them on a vehicle in the air.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, TruthV1};
use oqtal_bus::time::Span;
use oqtal_plant_sim::{Plant, SceneDisturbance};

use crate::{HOVER, START, calm};

/// The default vehicle with `disturb`, without wind, drift and drag.
fn plant(disturb: &str, more: &[(&str, toml::Value)]) -> Plant {
    let base = [
        ("plant.drag-per-s", 0.0.into()),
        ("plant.thrust-lag-ms", 0.0.into()),
        ("plant.disturb", vec![disturb.to_owned()].into()),
    ];
    Plant::new(&calm(&[&base, more].concat()), START)
}

/// The truth after `millis` of repeated hover commands, armed at the start.
fn after(plant: &mut Plant, millis: i64) -> TruthV1 {
    let from = plant.truth().time;
    plant.disturb(SceneDisturbance { armed_at: Some(START), ..SceneDisturbance::default() });
    let actuation = Actuation::Sticks.code();
    let command = CommandV1 { actuation, thrust: HOVER, ..CommandV1::default() };
    for step in 1..=millis / 50 {
        let now = from + Span::from_millis(50 * step);
        plant.receive(plant.truth().time, Header::default(), command, 0);
        plant.advance(now, |_| ());
    }
    plant.truth()
}

#[test]
fn a_force_accelerates_by_its_part_of_the_mass_for_its_time() {
    let mut plant = plant("force@1+0.5=0.2,0,1N", &[]);
    assert_eq!(after(&mut plant, 1000).velocity, [0.0; 3], "on the floor, at rest");
    let velocity = after(&mut plant, 1000).velocity;
    assert!((velocity[0] - 0.2).abs() < 1e-9, "{velocity:?}: 0.4 m/s^2 for half a second");
    assert!((velocity[2] - 1.0).abs() < 2e-2, "{velocity:?}: 2 m/s^2, less what the floor holds");
}

#[test]
fn a_disturbance_begins_and_ends_between_two_milliseconds() {
    let mut plant = plant("force@0.50025+0.0005=100,0,100N", &[]);
    let velocity = after(&mut plant, 1000).velocity;
    assert!((velocity[0] - 0.1).abs() < 1e-9, "{velocity:?}: 200 m/s^2 for half a millisecond");
}

/// Lifts the vehicle off the floor; it floats from half a second on.
const LIFT: &str = "force@0+0.5=0,0,1N";

fn disturbed(also: &str) -> (&'static str, toml::Value) {
    ("plant.disturb", toml::Value::from(vec![LIFT.to_owned(), also.to_owned()]))
}

#[test]
fn a_payload_sinks_and_a_lighter_vehicle_climbs() {
    for (disturb, expected) in [("mass@1=0.5kg", -9.81 / 2.0), ("mass@1=-0.25kg", 9.81)] {
        let mut plant = plant(LIFT, &[disturbed(disturb)]);
        let before = after(&mut plant, 1000).velocity[2];
        let found = (after(&mut plant, 100).velocity[2] - before) / 0.1;
        assert!((found - expected).abs() < 0.01, "{disturb}: {found}, expected {expected}");
    }
}

#[test]
fn a_gust_pushes_through_the_drag_by_half_its_peak_on_average() {
    let drag = 1e-3;
    let settings = [disturbed("gust@1+1=2,0,0m/s"), ("plant.drag-per-s", drag.into())];
    let mut plant = plant(LIFT, &settings);
    assert_eq!(after(&mut plant, 1000).velocity[0], 0.0);
    let pushed = after(&mut plant, 1000).velocity[0];
    // The mean of 1 - cos over its period is 1/2.
    assert!((pushed / (drag * 2.0 / 2.0) - 1.0).abs() < 1e-2, "{pushed}");
    assert!((after(&mut plant, 500).velocity[0] / pushed - 1.0).abs() < 1e-2, "it is over");
}

#[test]
fn a_torque_turns_a_vehicle_whose_rate_is_held_by_its_lag() {
    // J_x = 3.65e-3 kg m^2, rate loop of 50 ms: a constant torque causes a steady rate of tau / J times 50 ms.
    let mut plant = plant(LIFT, &[disturbed("torque@0.5=0.01,0,0Nm")]);
    let rate = after(&mut plant, 1000).rate;
    let expected = 0.01 / 3.65e-3 * 0.05;
    assert!((rate[0] / expected - 1.0).abs() < 1e-3, "{rate:?}, expected {expected}");
}

#[test]
fn before_arming_nothing_acts() {
    let mut plant = plant("force@0=0,0,100N", &[]);
    plant.disturb(SceneDisturbance::default());
    plant.advance(START + Span::from_millis(500), |_| ());
    assert_eq!(plant.truth().position, [0.0; 3]);
}
