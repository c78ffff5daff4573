//! Flights through MAVLink: real processes, real datagrams on the loopback network, in real time.

mod common;

use std::net::UdpSocket;

use common::{Testbed, number, stderr};

/// Flies the square with these words through an emulated autopilot; it is as accurate as the direct simulation of `vehicle` at the same
/// delay. Returns the summary.
fn square_as_good_as(vehicle: &str, words: &[&str]) -> serde_json::Value {
    let testbed = Testbed::new("mav-square");
    let wired = testbed.summary(&[words, &["--seed", "7"]].concat());
    assert_eq!(wired["outcome"], "landed", "{wired:#}");
    let direct = testbed.summary(&["--vehicle", vehicle, "--clock", "in-process", "--seed", "7"]);
    for error in ["position_error_m", "velocity_error_m_s", "attitude_error_deg"] {
        let path = format!("/{error}/mean");
        let ratio = number(&wired, &path) / number(&direct, &path);
        assert!((0.85..1.15).contains(&ratio), "{vehicle}, {error}: {ratio} of the direct flight");
    }
    wired
}

#[test]
fn the_square_over_mavlink_is_as_good_as_without_it() {
    let words = ["--vehicle", "bridge:mavlink", "--set", "plant.wire.latency-ms=19"];
    let wired = square_as_good_as("sim", &words);
    assert_eq!(wired["vehicle"], "bridge:mavlink");
    // Measured by exchanges of clocks: half of a round trip, one way of which takes 19 ms.
    let on_wire = number(&wired, "/hops/wire/p50_ns");
    assert!(on_wire >= 9.5e6, "{on_wire} ns");
    assert!(number(&wired, "/hops/wire/count") > 1000.0);
}

#[test]
fn the_square_of_the_preset_ardupilot_quad_is_as_good_as_without_mavlink() {
    let vehicle = "bridge:mavlink,autopilot=ardupilot";
    let preset = "vehicle.preset=ardupilot-quad";
    square_as_good_as("sim:ardupilot-quad", &["--vehicle", vehicle, "--set", preset]);
}

#[test]
fn the_square_of_the_preset_px4_quad_is_as_good_as_without_mavlink() {
    let vehicle = "bridge:mavlink,autopilot=px4";
    let preset = "vehicle.preset=px4-quad";
    square_as_good_as("sim:px4-quad", &["--vehicle", vehicle, "--set", preset]);
}

/// PX4 with 1 % of datagrams lost and 5 ms of jitter, and ArduCopter that is told attitudes.
#[test]
fn a_hover_lands_through_losses_and_by_attitudes() {
    // Time for a sequence of which something is lost, as in the preset.
    let noise = [
        "plant.wire.loss-probability=0.01",
        "plant.wire.jitter-ms=5",
        "bridge.motor-sequence-ms=6000",
        "safety.motor-start-ms=6500",
    ];
    for (vehicle, settings) in [
        ("bridge:mavlink,autopilot=px4", &noise[..]),
        ("bridge:mavlink,autopilot=ardupilot,system=7", &["vehicle.interface=attitude"]),
    ] {
        let testbed = Testbed::new("mav-hover");
        let out = testbed.path("out");
        let hover = ["--vehicle", vehicle, "--trajectory", "hover", "--duration", "2"];
        let settings = settings.iter().flat_map(|setting| ["--set", setting]);
        let written = ["--out", out.to_str().unwrap()];
        let words: Vec<&str> = hover.into_iter().chain(settings).chain(written).collect();
        let summary = testbed.summary(&words);
        assert_eq!(summary["outcome"], "landed", "{vehicle}: {summary:#}");
        let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
        assert!(log.contains("motors have stopped"), "{vehicle}: {log}");
        assert_eq!(summary["vehicle"], vehicle);
    }
}

#[test]
fn a_vehicle_that_refuses_to_arm_is_told_in_its_own_words() {
    let testbed = Testbed::new("mav-refuses");
    let out = testbed.path("out");
    let setting = "plant.wire.mavlink.refuses-arming-ms=60000";
    let words = ["--vehicle", "bridge:mavlink", "--set", setting, "--out", out.to_str().unwrap()];
    let output = testbed.fly(&words);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
    assert!(log.contains("the vehicle refuses to arm"), "{log}");
    assert!(log.contains("the vehicle says: Arm: Gyros inconsistent"), "{log}");
}

/// An autopilot that refuses to arm for as long as some do after they were switched on: the time of the flight is over in the air.
#[test]
fn a_flight_that_begins_late_is_landed_and_not_dropped() {
    let testbed = Testbed::new("mav-late");
    let out = testbed.path("out");
    let settings = [
        "plant.wire.mavlink.refuses-arming-ms=19000",
        "bridge.motor-sequence-ms=30000",
        "safety.motor-start-ms=31000",
    ];
    let hover = ["--vehicle", "bridge:mavlink", "--trajectory", "hover", "--duration", "1"];
    let settings = settings.iter().flat_map(|setting| ["--set", setting]);
    let written = ["--json", "--out", out.to_str().unwrap()];
    let words: Vec<&str> = hover.into_iter().chain(settings).chain(written).collect();
    let output = testbed.fly(&words);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("the flight lasted too long"), "{}", stderr(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // A fall from the hover would be a crash.
    assert_eq!(summary["outcome"], "timeout", "{summary:#}");
    let telemetry = std::fs::read_to_string(out.join("telemetry.csv")).unwrap();
    let (head, last) = (telemetry.lines().next().unwrap(), telemetry.lines().last().unwrap());
    let column = head.split(',').position(|name| name == "true_z_m").unwrap();
    let height: f64 = last.split(',').nth(column).unwrap().parse().unwrap();
    assert!(height < 0.05, "{height} m");
    assert!(telemetry.contains(",landing,"), "it flew");
}

#[test]
fn ports_vehicles_and_links_that_cannot_be_are_told_with_their_remedy() {
    let testbed = Testbed::new("mav-bad");
    let holder = UdpSocket::bind("127.0.0.1:0").unwrap();
    let used = holder.local_addr().unwrap();
    for (link, code, says) in [
        (format!("mavlink:udpin:{used}"), 75, "is used by another program"),
        ("mavlink:udpin:192.0.2.1:14550".to_owned(), 71, "is no address of this machine"),
        ("mavlink:udpout:no.such.host.invalid:1".to_owned(), 71, "no host"),
        (format!("mavlink:tcp:{used}"), 71, "nobody accepts a connection"),
        ("mavlink:serial:/dev/no-such-port".to_owned(), 71, "no serial port"),
        ("mavlink:udpin:14550".to_owned(), 78, "mavlink:udpin:HOST:PORT"),
    ] {
        let output = testbed.oqtal(&["bridge", "run", "--link", &link]).output().unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{link}: {message}");
        assert!(message.contains(says), "{link}: {message}");
    }
    for (link, code, says) in [
        ("asctec:/dev/ttyUSB0", 64, "only vehicles of MAVLink"),
        ("mavlink:tcp:14550", 64, "mavlink:tcp:HOST:PORT"),
        (&format!("mavlink:udpin:{used}"), 75, "is used by another program"),
    ] {
        let output = testbed.oqtal(&["bridge", "setup", link]).output().unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{link}: {message}");
        assert!(message.contains(says), "{link}: {message}");
    }
}

/// A vehicle fresh from the factory is told what is wrong, is set up, and is then right.
#[test]
fn a_vehicle_is_set_up_and_read_back() {
    for autopilot in ["ardupilot", "px4"] {
        let testbed = Testbed::new("mav-setup");
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let wire = format!("mavlink:udpin:{free},autopilot={autopilot}");
        let vehicle = testbed.start(&["plant-sim", "run", "--wire", &wire]);
        let link = format!("mavlink:udpout:{free}");
        let setup = |words: &[&str]| {
            let words = [&["bridge", "setup", &link], words].concat();
            let output = testbed.oqtal(&words).output().unwrap();
            let table = String::from_utf8_lossy(&output.stdout).into_owned();
            (output.status.code(), table, stderr(&output))
        };
        let (code, table, message) = setup(&[]);
        assert_eq!(code, Some(1), "{table}{message}");
        assert!(table.contains("wrong") && !table.contains("none"), "{table}");
        let (code, table, message) = setup(&["--apply"]);
        assert_eq!(code, Some(0), "{table}{message}");
        let (code, table, _) = setup(&[]);
        assert!(code == Some(0) && !table.contains("wrong"), "{table}");
        vehicle.signal(rustix::process::Signal::TERM);
        assert!(vehicle.wait().status.success());
    }
}
