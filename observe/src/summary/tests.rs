use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Setting;

use super::*;
use crate::report::tests::fixture;

#[test]
fn a_preset_with_other_values_is_not_named_as_the_preset() {
    let vehicle = |settings: &[&str]| {
        let settings: Vec<_> =
            settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
        let config = Config::from_settings(&settings).unwrap();
        Summary::of(&Flight { config, ..fixture::square() }).vehicle.to_string()
    };
    let preset = "vehicle.preset=crazyflie-2.1";
    assert_eq!(vehicle(&[preset]), "sim:crazyflie-2.1,fidelity=eq61");
    let changed = "sim:crazyflie-2.1,fidelity=eq61 with changed values";
    assert_eq!(vehicle(&[preset, "vehicle.mass-kg=0.031"]), changed);
    assert_eq!(vehicle(&[preset, "plant.rate-lag-ms=31"]), changed);
}

#[test]
fn states_between_two_flights_of_a_recording_are_of_neither() {
    let mut flight = fixture::square();
    let one = flight.samples.len();
    for _ in 0..2 {
        flight.samples.extend_from_within(..one);
    }
    for (k, sample) in flight.samples.iter_mut().enumerate() {
        let is_between = k / one == 1;
        let mode = if is_between { Mode::Disarmed } else { Mode::Flying };
        let state = if is_between { SafetyState::Coast } else { SafetyState::Nominal };
        (sample.telemetry.mode, sample.telemetry.state) = (mode.code(), state.code());
        sample.telemetry.time = Time::VIRTUAL_START + COUNTED_AFTER.scaled(2.0 * k as f64);
    }
    assert_eq!(Summary::of(&flight).state_sequence, ["Nominal"]);
}

#[test]
fn misses_at_the_end_of_each_flight_of_a_recording_count() {
    let mut flight = fixture::square();
    let one = flight.samples.len();
    flight.samples.extend_from_within(..);
    for (k, sample) in flight.samples.iter_mut().enumerate() {
        // Each flight ends with a late tick.
        let ended = (k + 1).div_euclid(one) as u64;
        let tick = &mut sample.telemetry;
        (tick.deadline_misses, tick.poses_superseded) = (ended, 100 * ended);
        let mode = if (k + 1) % one == 0 { Mode::Disarmed } else { Mode::Flying };
        tick.mode = mode.code();
        tick.time = Time::VIRTUAL_START + Span::from_millis(17 * k as i64);
    }
    let summary = Summary::of(&flight);
    assert_eq!((summary.deadline_misses, summary.poses_superseded), (2, 200));
}
