//! `oqtal identify`, from a recording to a flight with the identified configuration.

use crate::common::{Testbed, assert_refused, stderr};

/// A vehicle that differs from the configured one.
const PLANT: [&str; 2] = ["--plant", "rate-lag-ms=62"];

#[test]
fn a_recorded_flight_is_identified_and_differences_are_reported() {
    let testbed = Testbed::new("identify");
    let flown =
        ["--trajectory", "excitation", "--duration", "46", "--clock", "in-process", "--seed", "7"];
    let recorded = ["--set", "trajectory.settle-s=1", "--set", "record.flights=all"];
    let places = ["flight", "flight/flight.mcap", "found"].map(|name| testbed.path(name));
    let [out, recording, found] = places.each_ref().map(|path| path.to_str().unwrap());
    testbed.lands(&[&flown[..], &recorded, &PLANT, &["--out", out]].concat());
    let identify = ["identify", recording, "--mass", "0.5", "--out", found];
    let table = testbed.succeeds(&identify);
    let again = testbed.study(&identify).output().unwrap();
    assert_refused(&again, 64, &["vehicle.toml exists already", "--force"]);
    let text = std::fs::read_to_string(testbed.path("found/identification.json")).unwrap();
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    let command = document["command"].as_str().unwrap();
    assert!(
        command.starts_with("oqtal identify /") && command.ends_with("--mass 0.5"),
        "{command}"
    );
    assert!(document["config_hash"].is_string() && testbed.path("found/config.toml").is_file());
    let grams = ["identify", recording, "--mass", "500", "--out", "grams"];
    testbed.refuses(&grams, 64, &["not within 0.01 to 50 kg"]);
    let widest = table.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(80), "{widest:?} columns\n{table}");
    let file = format!("{found}/vehicle.toml");
    let vehicle = std::fs::read_to_string(testbed.path(&file)).unwrap();
    assert!(!vehicle.contains("duration-s"), "{vehicle}");
    let checked = testbed.study(&["check", &file]).output().unwrap();
    let said = stderr(&checked);
    assert!(checked.status.success(), "{said}");
    let lag = said.lines().find(|line| line.contains("vehicle.rate-lag-ms")).unwrap();
    let found_ms: f64 = lag.split([' ', ',']).nth(3).unwrap().parse().unwrap();
    assert!((found_ms - 62.0).abs() < 3.0 && lag.contains("shipped 50.0"), "{lag}");
    assert!(!said.contains("mass-kg"), "the mass was given: {said}");
}

#[test]
fn a_vehicle_that_holds_attitudes_is_refused_with_a_remedy() {
    let testbed = Testbed::new("identify-attitude");
    let words = ["identify", "--fly", "--set", "vehicle.interface=attitude"];
    let output = testbed.study(&words).output().unwrap();
    assert_refused(&output, 64, &["vehicle.interface = \"rate\""]);
}
