//! Requests of operators that come together: real processes, and nothing in half.

use std::process::Output;

use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};

use crate::common::obedience::MotorWatch;
use crate::common::{Testbed, json, stderr, wait_for};

fn ctl(testbed: &Testbed, words: &[&str]) -> Output {
    testbed.oqtal(&[&["ctl"], words].concat()).output().unwrap()
}

/// Both outputs of `oqtal ctl` with these arguments.
fn said(testbed: &Testbed, words: &[&str]) -> String {
    let answer = ctl(testbed, words);
    String::from_utf8_lossy(&answer.stdout).into_owned() + &stderr(&answer)
}

#[test]
fn of_two_operators_who_set_the_same_keys_at_once_one_wins_as_a_whole() {
    let testbed = Testbed::new("two-set");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    let keys = ["position.tilt-limit-deg", "position.horizontal-velocity-limit-m-s"];
    let requests = [["11", "0.7"], ["13", "0.6"]];
    for _ in 0..5 {
        std::thread::scope(|scope| {
            for values in &requests {
                scope.spawn(|| {
                    let words = [0, 1].map(|k| format!("{}={}", keys[k], values[k]));
                    let done = ctl(&testbed, &["set", &words[0], &words[1]]);
                    assert!(done.status.success(), "{}", stderr(&done));
                });
            }
        });
        let values = keys.map(|key| {
            let answer = ctl(&testbed, &["get", key]);
            let text = String::from_utf8_lossy(&answer.stdout).into_owned();
            text.trim().rsplit([' ', '=']).next().unwrap().parse::<f64>().expect(&text)
        });
        let whole = requests.map(|it| it.map(|value| value.parse::<f64>().unwrap()));
        assert!(whole.contains(&values), "{values:?}");
    }
}

#[test]
fn under_fly_a_reload_without_a_file_is_refused_since_the_daemon_reads_a_copy() {
    let testbed = Testbed::new("copy-reload");
    let file = testbed.path("my.toml");
    let write = |deg| std::fs::write(&file, format!("[position]\ntilt-limit-deg = {deg}\n"));
    write(14.0).unwrap();
    let words = ["--config", "my.toml", "--trajectory", "hover", "--duration", "30"];
    let _flight = testbed.start(&[&["fly"], &words[..]].concat());
    testbed.wait_for_daemon();
    write(11.0).unwrap();
    testbed.refuses(&["ctl", "reload"], 1, &["with a copy", "name the file"]);
    assert!(ctl(&testbed, &["reload", "my.toml"]).status.success());
    testbed.refuses(&["ctl", "reload"], 1, &["with a copy"]);
    assert!(ctl(&testbed, &["stop"]).status.success());
}

#[test]
fn hints_name_a_file_that_was_edited_after_the_daemon_had_read_it() {
    let testbed = Testbed::new("edited-file");
    let file = testbed.write("my.toml", "[position]\ntilt-limit-deg = 14.0\n");
    let name = file.display().to_string();
    let said = |words: &[&str]| said(&testbed, words);
    let start = |process| testbed.start(&[process, "run", "--config", &name]);
    let [_plant, _cameras, daemon] = ["plant-sim", "mocap-emu", "daemon"].map(start);
    testbed.wait_for_daemon();
    assert!(!said(&["status"]).contains(&name));
    std::fs::write(&file, "[position]\ntilt-limit-deg = 11.0\n").unwrap();
    let edited = format!("{name}: edited without effect on the daemon");
    for words in [&["status"][..], &["get"], &["set", "position.tilt-limit-deg=12"], &["undo"]] {
        let told = said(words);
        assert!(told.contains(&edited), "{words:?}: {told}");
    }
    assert!(said(&["reload"]).contains("tilt-limit-deg=11"));
    assert!(said(&["undo"]).contains(&edited) && said(&["reload"]).contains("tilt-limit-deg=11"));
    assert!(!said(&["get"]).contains(&name) && said(&["reload"]).contains("no setting differs"));
    std::fs::write(&file, "[position]\ntilt-limit-deg = 10.0\n").unwrap();
    assert!(said(&["stop"]).contains(&edited));
    std::fs::rename(&file, file.with_extension("away")).unwrap();
    assert!(said(&["get"]).contains(&format!("{name}: removed; ")));
    std::fs::rename(file.with_extension("away"), &file).unwrap();
    daemon.signal(rustix::process::Signal::TERM);
    daemon.wait();
    let lacks = format!(
        "that uses the settings with which the last daemon was started, without later edits of {name}"
    );
    for words in [["stop"], ["arm"], ["land"]] {
        let told = said(&words);
        assert!(told.contains(&lacks), "{words:?}: {told}");
    }
}

#[test]
fn a_stop_between_reloads_is_obeyed_at_once() {
    let testbed = Testbed::new("stop-reload");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    for tilt in ["11", "13"] {
        let text = format!("[position]\ntilt-limit-deg = {tilt}.0\n");
        std::fs::write(testbed.path(&format!("{tilt}.toml")), text).unwrap();
    }
    let mut motors = MotorWatch::open(&bus);
    std::thread::scope(|scope| {
        let reloads = scope.spawn(|| {
            // The stop comes while these follow one another.
            for file in ["11.toml", "13.toml"].iter().cycle().take(12) {
                ctl(&testbed, &["reload", file]);
            }
        });
        motors.obeys(|| {
            let stopped = ctl(&testbed, &["stop", "--json"]);
            assert!(stopped.status.success(), "{}", stderr(&stopped));
            assert_eq!(json(&stopped)["motors_off"], true);
        });
        reloads.join().unwrap();
    });
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let (_, tick) = wait_for("a tick", || telemetry.latest().unwrap());
    assert!(!tick.is_armed(), "a reload begins no flight");
}

#[test]
fn an_edited_waypoint_file_is_named_refused_for_an_expected_configuration_and_read_by_a_reload() {
    let testbed = Testbed::new("edited-waypoints");
    let points = |y: f64| format!("t,x,y,z\n0,0,0,1\n4,0,{y},1\n8,0,0,1\n");
    let path = testbed.write("path.csv", &points(0.4));
    let file = testbed
        .write("my.toml", "[trajectory]\nkind = \"waypoints\"\nwaypoints-file = \"path.csv\"\n");
    let (name, path) = (file.display().to_string(), path.display().to_string());
    let said = |words: &[&str]| said(&testbed, words);
    let start = |process| testbed.start(&[process, "run", "--config", &name]);
    let [_plant, _cameras, daemon] = ["plant-sim", "mocap-emu", "daemon"].map(start);
    testbed.wait_for_daemon();
    assert!(!said(&["status"]).contains("path.csv"));
    std::fs::write(&path, points(0.8)).unwrap();
    let edited = format!("{path}: edited since the daemon read it");
    for words in [&["status"][..], &["get"], &["arm", "--config", &name]] {
        let told = said(words);
        assert!(told.contains(&edited), "{words:?}: {told}");
    }
    testbed.refuses(&["ctl", "arm", "--config", &name], 1, &["arm refused: ", &edited]);
    assert!(said(&["reload"]).contains(&format!("trajectory.waypoints-file=\"{path}\"")));
    assert!(!said(&["status"]).contains("path.csv: ") && said(&["reload"]).contains("no setting"));
    daemon.signal(rustix::process::Signal::KILL);
    daemon.wait();
    let copy = testbed.paths().config().display().to_string();
    let _again = testbed.start(&["daemon", "run", "--config", &copy]);
    testbed.wait_for_daemon();
    assert!(said(&["get"]).contains("trajectory waypoints"));
}
