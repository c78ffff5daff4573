//! `oqtal fly --disturb`: disturbances act in every clock, and stand in all that remains of a flight.

mod common;

use std::process::Command;

use common::{Testbed, stderr};
use serde_json::Value;

/// A hover with a push and a payload.
const DISTURBED: [&str; 12] = [
    "fly",
    "--trajectory",
    "hover",
    "--duration",
    "3",
    "--seed",
    "7",
    "--disturb",
    "force@5+0.5=0.3,0,0",
    "--disturb",
    "mass@7=0.05kg",
    "--json",
];

fn flown(testbed: &Testbed, clock: &str) -> Value {
    let mut command = testbed.oqtal(&DISTURBED);
    let out = testbed.path(clock);
    let output = command.args(["--clock", clock, "--out"]).arg(out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Distances of the vehicle along x \[m\] at the ticks before and after the push.
fn pushed(testbed: &Testbed, clock: &str) -> (f64, f64) {
    let table = std::fs::read_to_string(testbed.path(clock).join("telemetry.csv")).unwrap();
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let column = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let (time, x) = (column("t_s"), column("true_x_m"));
    let far = |from: f64, to: f64| {
        let within = |row: &&Vec<&str>| (from..to).contains(&row[time].parse().unwrap());
        let rows: Vec<Vec<&str>> = rows.clone().collect();
        rows.iter().filter(within).map(|row| row[x].parse().unwrap()).fold(0.0, f64::max)
    };
    (far(4.0, 5.0), far(5.0, 6.5))
}

#[test]
fn virtual_clocks_agree_and_every_clock_shows_the_push() {
    let testbed = Testbed::new("disturbed");
    let [one, other, real] = ["in-process", "lockstep", "real"].map(|clock| flown(&testbed, clock));
    assert_eq!(one["trajectory_hash"], other["trajectory_hash"]);
    for (clock, summary) in [("in-process", &one), ("lockstep", &other), ("real", &real)] {
        let loads = summary["disturbances"].as_array().unwrap();
        assert_eq!(loads.len(), 2, "{clock}: {summary}");
        assert_eq!(loads[0]["disturbance"], "force@5+0.5=0.3,0,0N");
        assert_eq!((&loads[0]["from_s"], &loads[0]["until_s"]), (&5.0.into(), &5.5.into()));
        assert_eq!(loads[1]["until_s"], Value::Null);
        let (before, after) = pushed(&testbed, clock);
        assert!(before < 0.03 && after > 0.04, "{clock}: {before} m before, {after} m after");
    }
}

#[test]
fn report_table_and_recording_name_them() {
    let testbed = Testbed::new("disturbed-shown");
    flown(&testbed, "lockstep");
    let page = std::fs::read_to_string(testbed.path("lockstep/report.html")).unwrap();
    assert!(page.contains("disturbance force@5+0.5=0.3,0,0N begins"));
    let recording = testbed.path("lockstep/flight.mcap").display().to_string();
    let oqtal = || Command::new(env!("CARGO_BIN_EXE_oqtal"));
    let output = oqtal().args(["report", &recording]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("disturbances: force@5+0.5=0.3,0,0N"), "{said}{}", stderr(&output));
    // Recordings are not compressed: the words of an event stand in them.
    let bytes = std::fs::read(&recording).unwrap();
    let told = b"force@5+0.5=0.3,0,0N ends";
    assert!(bytes.windows(told.len()).any(|window| window == told));
}

#[test]
fn a_wrong_one_is_told_the_grammar_and_a_real_vehicle_cannot_be_disturbed() {
    let testbed = Testbed::new("disturbed-wrong");
    let refused = |words: &[&str]| {
        let output = testbed.fly(words);
        (output.status.code(), stderr(&output))
    };
    let (code, message) = refused(&["--disturb", "wind@3=1"]);
    assert_eq!(code, Some(64), "{message}");
    for kind in ["force@5+1=0.3,0,0N", "torque@", "gust@", "mass@5=0.05kg"] {
        assert!(message.contains(kind), "{message}");
    }
    let (code, message) = refused(&["--disturb", "mass@3=-0.6kg"]);
    assert_eq!(code, Some(78), "{message}");
    assert!(message.contains("--disturb") && message.contains("-0.450 kg"), "{message}");
    let link = ["--vehicle", "link:asctec:/dev/null", "--set", "safety.allow-emulated-poses=true"];
    let (code, message) = refused(&[&link[..], &["--disturb", "mass@3=0.1kg"]].concat());
    assert_eq!(code, Some(64), "{message}");
    assert!(message.contains("only a vehicle that this program simulates"), "{message}");
}
