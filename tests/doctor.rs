//! `oqtal doctor` on this machine: the form of its findings, and the files left by a killed daemon.

use crate::common::{Testbed, json, stderr, wait_for};
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;
use serde_json::Value;

fn examine(testbed: &Testbed) -> Value {
    json(&testbed.oqtal(&["doctor", "--json"]).output().unwrap())
}

#[test]
fn every_check_reports_its_finding_and_every_problem_a_remedy() {
    let testbed = Testbed::new("doctor");
    let document = examine(&testbed);
    let checks = document["checks"].as_array().unwrap();
    assert!(checks.len() >= 8, "{document}");
    for check in checks {
        for key in ["name", "found", "why"] {
            assert!(!check[key].as_str().unwrap().is_empty(), "{check}");
        }
        let level = check["level"].as_str().unwrap();
        assert!(["ok", "advice", "problem"].contains(&level), "{check}");
        assert!(level != "problem" || check["remedy"].is_string(), "{check}");
    }
    let text = testbed.oqtal(&["doctor"]).output().unwrap();
    assert_eq!(text.status.code() == Some(0), document["level"] != "problem");
    assert!(String::from_utf8_lossy(&text.stdout).contains("fit to fly"));
}

#[test]
fn a_dead_instance_is_found_and_named_in_its_remedy() {
    let testbed = Testbed::new("dead");
    find_the_dead(&testbed);
    // `ctl status` removes nothing.
    let before = testbed.remains();
    testbed.refuses(&["ctl", "status"], 75, &["no daemon answers"]);
    assert_eq!(testbed.remains(), before);
    // Remedy proposed by the finding.
    let output = testbed.oqtal(&["doctor", "--remove-strays"]).output().unwrap();
    assert!(stderr(&output).contains(&format!("removed: {} (", testbed.instance())));
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

fn find_the_dead(testbed: &Testbed) {
    let bus = testbed.bus();
    let mut commands = bus.observer(&oqtal_bus::topic::COMMAND).unwrap();
    let daemon = testbed.start(&["daemon", "run", "--set", "realtime.scheduling=other"]);
    wait_for("commands", || commands.latest().unwrap());
    drop((commands, bus));
    daemon.signal(Signal::KILL);
    daemon.wait();
    let remains = |document: Value| {
        let checks = document["checks"].as_array().unwrap().clone();
        checks.into_iter().find(|check| check["name"] == "remains of dead instances").unwrap()
    };
    let found = remains(examine(testbed));
    assert!(found["found"].as_str().unwrap().contains(testbed.instance()), "{found}");
    assert_eq!(found["remedy"], "oqtal doctor --remove-strays", "{found}");
}
