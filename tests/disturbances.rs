//! `oqtal fly --disturb`: disturbances act with every clock and are listed in all results of a flight.

use crate::common::{Testbed, json, stderr};
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
    json(&output)
}

/// Positions of the vehicle along x \[m\] at the ticks before and after the push.
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
    let text = testbed.succeeds(&["report", &recording]);
    assert!(text.contains("disturbances: force@5+0.5=0.3,0,0N"), "{text}");
    // Recordings are not compressed, so they contain the text of an event.
    let bytes = std::fs::read(&recording).unwrap();
    let event = b"force@5+0.5=0.3,0,0N ends";
    assert!(bytes.windows(event.len()).any(|window| window == event));
}

#[test]
fn a_wrong_disturbance_is_refused_with_the_grammar_and_a_real_vehicle_cannot_be_disturbed() {
    let testbed = Testbed::new("disturbed-wrong");
    let kinds = ["force@5+1=0.3,0,0N", "torque@", "gust@", "mass@5=0.05kg"];
    testbed.refuses(&["fly", "--disturb", "wind@3=1"], 64, &kinds);
    let heavy = ["fly", "--disturb", "mass@3=-0.6kg"];
    testbed.refuses(&heavy, 78, &["--disturb", "-0.450 kg"]);
    let link = ["fly", "--vehicle", "link:asctec:/dev/null"];
    let emulated = ["--set", "safety.allow-emulated-poses=true", "--disturb", "mass@3=0.1kg"];
    let words = [&link[..], &emulated].concat();
    testbed.refuses(&words, 64, &["only a vehicle that this program simulates"]);
}
