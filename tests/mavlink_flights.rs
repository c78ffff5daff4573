//! Flights through MAVLink: real processes, real datagrams on the loopback network, in real time.

use std::net::UdpSocket;

use crate::common::network::free_port;
use crate::common::{
    TWO_CORNERS, Testbed, assert_as_good_as, assert_refused, json, number, stderr,
};

/// Flies the square with these arguments through an emulated autopilot; it must be as accurate as the direct simulation of
/// `vehicle` with the same delay. Returns the summary.
fn square_as_good_as(vehicle: &str, words: &[&str]) -> serde_json::Value {
    let testbed = Testbed::new("mav-square");
    let wired = testbed.lands(&[words, &TWO_CORNERS].concat());
    let direct = ["--vehicle", vehicle, "--clock", "in-process"];
    let direct = testbed.summary(&[&direct[..], &TWO_CORNERS].concat());
    assert_as_good_as(&wired, &direct);
    wired
}

#[test]
fn the_square_over_mavlink_is_as_good_as_without_it() {
    let words = ["--vehicle", "bridge:mavlink", "--set", "plant.wire.latency-ms=19"];
    let wired = square_as_good_as("sim", &words);
    assert_eq!(wired["vehicle"], "bridge:mavlink");
    // Half of a round trip, measured by clock exchanges; one direction takes 19 ms.
    let on_wire = number(&wired, "/hops/wire/p50_ns");
    assert!(on_wire >= 9.5e6, "{on_wire} ns");
    assert!(number(&wired, "/hops/wire/count") > 500.0);
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

/// PX4 with 1 % of datagrams lost and 5 ms of jitter, and ArduCopter commanded by attitudes.
#[test]
fn a_hover_lands_through_losses_and_by_attitudes() {
    // Time for a sequence with losses, as in the preset.
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
        let summary = testbed.lands(&words);
        let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
        assert!(log.contains("motors have stopped"), "{vehicle}: {log}");
        assert_eq!(summary["vehicle"], vehicle);
    }
}

#[test]
fn a_refusal_to_arm_is_logged_in_the_words_of_the_vehicle() {
    let testbed = Testbed::new("mav-refuses");
    let out = testbed.path("out");
    let setting = "plant.wire.mavlink.refuses-arming-ms=60000";
    let words = ["--vehicle", "bridge:mavlink", "--set", setting, "--out", out.to_str().unwrap()];
    assert_refused(&testbed.fly(&words), 1, &["motors not running"]);
    let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
    assert!(log.contains("the vehicle refuses to arm"), "{log}");
    assert!(log.contains("the vehicle says: Arm: Gyros inconsistent"), "{log}");
}

/// An autopilot that refuses to arm for some time after its start, so that the time-out of the flight expires in the air.
#[test]
fn a_flight_that_begins_late_is_landed_and_not_stopped_in_the_air() {
    let testbed = Testbed::new("mav-late");
    let out = testbed.path("out");
    let settings = [
        "plant.wire.mavlink.refuses-arming-ms=19000",
        "bridge.motor-sequence-ms=30000",
        "safety.motor-start-ms=31000",
        // A pause of this machine by three periods would withdraw the start.
        "bridge.command-timeout-periods=15",
    ];
    let hover = ["--vehicle", "bridge:mavlink", "--trajectory", "hover", "--duration", "1"];
    let settings = settings.iter().flat_map(|setting| ["--set", setting]);
    let written = ["--json", "--out", out.to_str().unwrap()];
    let words: Vec<&str> = hover.into_iter().chain(settings).chain(written).collect();
    let output = testbed.fly(&words);
    assert_refused(&output, 1, &["the flight lasted too long"]);
    let summary = json(&output);
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
fn impossible_ports_vehicles_and_links_are_refused_with_a_remedy() {
    let testbed = Testbed::new("mav-bad");
    let holder = UdpSocket::bind("127.0.0.1:0").unwrap();
    let used = holder.local_addr().unwrap();
    for (link, code, says) in [
        (format!("mavlink:udpin:{used}"), 75, "is used by another program"),
        ("mavlink:udpin:192.0.2.1:14550".to_owned(), 71, "is not an address of this machine"),
        ("mavlink:udpout:no.such.host.invalid:1".to_owned(), 71, "no host"),
        (format!("mavlink:tcp:{used}"), 71, "no server accepts a connection"),
        ("mavlink:serial:/dev/no-such-port".to_owned(), 71, "no serial port"),
        ("mavlink:udpin:14550".to_owned(), 78, "mavlink:udpin:HOST:PORT"),
    ] {
        testbed.refuses(&["bridge", "run", "--link", &link], code, &[says]);
    }
    for (link, code, says) in [
        ("asctec:/dev/ttyUSB0", 64, "set `bridge.vehicle-time-out-ms`"),
        ("mavlink:tcp:14550", 64, "mavlink:tcp:HOST:PORT"),
        (&format!("mavlink:udpin:{used}"), 75, "is used by another program"),
    ] {
        testbed.refuses(&["bridge", "setup", link], code, &[says]);
    }
}

/// A vehicle with factory settings is checked, set up, and checked again.
#[test]
fn a_vehicle_is_set_up_and_read_back() {
    for autopilot in ["ardupilot", "px4"] {
        let testbed = Testbed::new("mav-setup");
        let free = format!("127.0.0.1:{}", free_port());
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
