//! `oqtal identify` from a recording to the configuration that flies with what was found.

mod common;

use std::process::{Command, Output};

use common::Testbed;

/// A vehicle that differs from the configured one, which the controller does not know.
const PLANT: [&str; 2] = ["--plant", "rate-lag-ms=62"];

fn oqtal(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_oqtal")).args(words).output().unwrap()
}

#[test]
fn a_recorded_flight_is_identified_and_what_changed_is_said() {
    let testbed = Testbed::new("identify");
    let flown = ["--trajectory", "excitation", "--clock", "in-process", "--seed", "7"];
    let recorded = ["--set", "trajectory.settle-s=1", "--set", "record.flights=all"];
    let places = ["flight", "flight/flight.mcap", "found"].map(|name| testbed.path(name));
    let [out, recording, found] = places.each_ref().map(|path| path.to_str().unwrap());
    let summary = testbed.summary(&[&flown[..], &recorded, &PLANT, &["--out", out]].concat());
    assert_eq!(summary["outcome"], "landed");
    let identified = oqtal(&["identify", recording, "--mass", "0.5", "--out", found]);
    assert!(identified.status.success(), "{}", common::stderr(&identified));
    let table = String::from_utf8(identified.stdout).unwrap();
    let widest = table.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(80), "{widest:?} columns\n{table}");
    let file = format!("{found}/vehicle.toml");
    let checked = oqtal(&["check", &file]);
    assert!(checked.status.success(), "{}", common::stderr(&checked));
    let said = common::stderr(&checked);
    let lag = said.lines().find(|line| line.contains("vehicle.rate-lag-ms")).unwrap();
    let found_ms: f64 = lag.split([' ', ',']).nth(3).unwrap().parse().unwrap();
    assert!((found_ms - 62.0).abs() < 3.0 && lag.contains("shipped 50.0"), "{lag}");
    assert!(!said.contains("mass-kg"), "the mass was told: {said}");
}

#[test]
fn a_vehicle_that_holds_attitudes_is_refused_with_a_remedy() {
    let refused = oqtal(&["identify", "--fly", "--set", "vehicle.interface=attitude"]);
    assert_eq!(refused.status.code(), Some(64));
    let said = common::stderr(&refused);
    assert!(said.contains("vehicle.interface = \"rate\""), "{said}");
}
