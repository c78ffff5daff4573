//! Flights of the emulated vehicle with Betaflight over MSP: real processes, real datagrams, in real time.

use std::net::{TcpListener, UdpSocket};

use crate::common::network::free_port;
use crate::common::{TWO_CORNERS, Testbed, assert_as_good_as, json, number, stderr, wait_for};

const WIRED: [&str; 2] = ["--vehicle", "bridge:msp"];

#[test]
fn the_square_over_msp_is_as_good_as_without_it() {
    let testbed = Testbed::new("msp-square");
    // MSP has no room for rates: the heading would oscillate, unlike that of the direct simulation.
    let steady = ["--set", "safety.probe-yaw-deg=0"];
    let wired = testbed.lands(&[&WIRED[..], &TWO_CORNERS, &steady].concat());
    assert_eq!(wired["vehicle"], "bridge:msp");
    let direct = ["--vehicle", "sim:betaflight-quad", "--clock", "in-process"];
    let direct = testbed.summary(&[&direct[..], &TWO_CORNERS].concat());
    assert_as_good_as(&wired, &direct);
    assert!(number(&wired, "/wire/link_quality/mean") > 0.95);
}

#[test]
fn motors_are_started_and_stopped_by_the_arming_switch() {
    let testbed = Testbed::new("msp-hover");
    let out = testbed.path("out");
    let hover = ["--trajectory", "hover", "--duration", "2", "--out", out.to_str().unwrap()];
    testbed.lands(&[&WIRED[..], &hover].concat());
    let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
    assert!(log.contains("motors run") && log.contains("motors have stopped"), "{log}");
    assert!(!log.contains("refuses"), "reasons that end by themselves are not reported: {log}");
}

/// The daemon stops the flight; the vehicle's own failsafe stops its motors.
#[test]
fn f65_a_silent_radio_of_msp_ends_in_a_stop() {
    let testbed = Testbed::new("msp-silent");
    let silent = ["--trajectory", "hover", "--duration", "11", "--fault", "radio:off@4", "--json"];
    let summary = json(&testbed.fly(&[&WIRED[..], &silent].concat()));
    assert_eq!(summary["outcome"], "stopped", "{summary:#}");
    assert!(number(&summary, "/duration_s") < 6.0, "{summary:#}");
}

/// A vehicle whose rates are those of another configuration is checked, not flown, set up, and checked again.
#[test]
fn a_vehicle_with_other_rates_is_not_flown_and_set_up() {
    let (testbed, elsewhere) = (Testbed::new("msp-setup"), Testbed::new("msp-vehicle"));
    let address = format!("127.0.0.1:{}", free_port());
    let (wire, link) = (format!("msp:udpin:{address}"), format!("msp:udpout:{address}"));
    let preset = "vehicle.preset=betaflight-quad";
    let other = "plant.rate-authority-rad-s=[6.0, 6.0, 6.0]";
    let words = ["plant-sim", "run", "--wire", &wire, "--set", preset, "--set", other];
    let _vehicle = elsewhere.start(&words);
    wait_for("the vehicle", || UdpSocket::bind(&address).is_err().then_some(()));
    let setup = |words: &[&str]| {
        let words = [&["bridge", "setup", &link, "--set", preset], words].concat();
        let output = testbed.oqtal(&words).output().unwrap();
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.stderr.is_empty(), "{}", stderr(&output));
        (output.status.code(), table)
    };
    let row = |table: &str, name: &str, word: &str| {
        let row = table.lines().find(|row| row.starts_with(name)).unwrap().to_owned();
        assert!(row.split_whitespace().any(|it| it == word), "{name}: {row}");
    };
    let (code, table) = setup(&[]);
    assert_eq!(code, Some(1), "{table}");
    row(&table, "yaw_srate", "wrong");
    row(&table, "roll_expo", "proportional");
    row(&table, "failsafe_delay", "wrong");
    let out = testbed.path("out");
    let vehicle = format!("link:{link}");
    let refused = ["--vehicle", &vehicle, "--set", preset, "--out", out.to_str().unwrap()];
    let bench = ["--set", "safety.allow-emulated-poses=true"];
    let output = testbed.fly(&[&refused[..], &bench].concat());
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
    assert!(log.contains("roll_rc_rate: run oqtal bridge setup"), "{log}");
    let (code, table) = setup(&["--apply"]);
    assert_eq!(code, Some(0), "{table}");
    row(&table, "yaw_srate", "set");
    let (code, table) = setup(&[]);
    assert_eq!(code, Some(0), "{table}");
    assert!(!table.contains(" wrong ") && !table.contains(" set "), "{table}");
}

#[test]
fn bad_use_of_msp_has_its_exit_code_and_message() {
    let testbed = Testbed::new("msp-wrong");
    let holder = TcpListener::bind("127.0.0.1:0").unwrap();
    let silent = format!("msp:tcp:{}", holder.local_addr().unwrap());
    let preset = "vehicle.preset=betaflight-quad";
    for (words, code, part) in [
        (&["bridge", "run", "--link", "msp:/dev/ttyACM0"][..], 78, "msp:serial:PATH"),
        (
            &["bridge", "check", "--link", &silent, "--set", "vehicle.interface=attitude"],
            78,
            "angle mode",
        ),
        (&["bridge", "check", "--link", &silent, "--set", "control.rate-hz=85"], 78, "at most 75"),
        (&["bridge", "run", "--link", "msp:serial:/dev/no-such-port"], 71, "no serial port"),
        (&["bridge", "setup", &silent, "--set", preset], 75, "no vehicle answers MSP"),
        (&["plant-sim", "run", "--wire", "msp:tcp:127.0.0.1:5761"], 78, "over UDP only"),
    ] {
        testbed.refuses(words, code, &[part]);
    }
}
