//! Flights through the bridge: real processes, real frames on a pseudo-terminal, in real time.

use crate::common::{Running, TWO_CORNERS, Testbed, assert_as_good_as, json, number, wait_for};
use oqtal_bus::topic::Role;
use oqtal_config::Config;
use rustix::process::Signal;
use serde_json::Value;

const WIRED: [&str; 2] = ["--vehicle", "bridge:asctec"];

/// A hover of this duration.
fn hover(seconds: &'static str) -> [&'static str; 6] {
    ["--trajectory", "hover", "--duration", seconds, "--seed", "7"]
}

/// The square over the wire is as accurate as without a wire, and its hops are reported.
#[test]
fn the_square_through_real_frames_is_as_good_as_without_them() {
    let testbed = Testbed::new("square");
    // An AscTec vehicle reports no rates: its heading would oscillate, unlike that of the direct simulation.
    let steady = ["--set", "safety.probe-yaw-deg=0"];
    let wired = testbed.lands(&[&WIRED[..], &TWO_CORNERS, &steady].concat());
    assert_eq!(wired["vehicle"], "bridge:asctec");
    assert_eq!(wired["error_source"], "truth");
    let direct = testbed.summary(&[&["--clock", "in-process"], &TWO_CORNERS[..]].concat());
    assert_as_good_as(&wired, &direct);
    // 17 bytes of ten bits at 57600 baud.
    let on_wire = number(&wired, "/hops/wire/p50_ns");
    assert!((2.9e6..3.1e6).contains(&on_wire), "{on_wire} ns");
    assert!(number(&wired, "/hops/wire/count") > 500.0);
    let occupancy = number(&wired, "/wire/command_occupancy");
    assert!((0.15..0.20).contains(&occupancy), "{occupancy}");
    let age = |since: &str| number(&wired, &format!("/wire/command_age/{since}/p50_ns"));
    assert!(age("from_publication") > on_wire && age("from_capture") > 15e6 + on_wire);
    assert!(number(&wired, "/wire/link_quality/mean") > 0.95);
    let report = std::fs::read_to_string(
        testbed.path("flights").join(format!("{}-1", testbed.instance())).join("report.html"),
    );
    assert!(report.unwrap().contains("occupied by commands"));
    assert!(!testbed.paths().directory().exists());
}

/// The poses usually show that the vehicle follows no commands (F58) before the bridge reports its silence, 1.5 s after the last reply.
/// Whether they do depends on the noise of a flight in real time.
#[test]
fn f18_a_failed_radio_is_told_as_a_silent_vehicle() {
    let testbed = Testbed::new("silent");
    let line = ["--controller", "oqtal-dt", "--fault", "radio:off@4", "--json"];
    let summary = json(&testbed.fly(&[&WIRED[..], &hover("11"), &line].concat()));
    let shortfall = summary["shortfall"].as_str().unwrap();
    let is_told = ["vehicle silent", "it had not answered"].map(|text| shortfall.contains(text));
    assert!(is_told.contains(&true), "{shortfall}");
    assert!(number(&summary, "/duration_s") < 5.7, "{summary:#}");
}

/// Beside an attitude a yaw rate is commanded, which the tracked model does not contain.
#[test]
fn a_vehicle_that_holds_attitudes_holds_its_heading() {
    let testbed = Testbed::new("heading");
    let attitude = ["--controller", "oqtal-dt", "--set", "vehicle.interface=attitude"];
    let steady = ["--set", "safety.probe-yaw-deg=0"];
    let summary = testbed.lands(&[&WIRED[..], &hover("11"), &attitude, &steady].concat());
    let yaw_deg = number(&summary, "/attitude_error_deg/rms_by_axis/2");
    assert!(yaw_deg < 0.3, "{yaw_deg} deg");
}

#[test]
fn both_api_modes_of_the_xbee_fly() {
    for framing in ["api1", "api2"] {
        let testbed = Testbed::new(framing);
        let vehicle = format!("bridge:asctec,xbee={framing}");
        let out = testbed.path("out");
        let words = ["--vehicle", &vehicle, "--out", out.to_str().unwrap()];
        let summary = testbed.lands(&[&words, &hover("1")[..]].concat());
        let log = std::fs::read_to_string(out.join("bridge.log")).unwrap();
        assert!(log.contains("motors have stopped"), "without an emergency stop: {log}");
        assert_eq!(summary["vehicle"], vehicle.as_str());
        // The 17 bytes alone take 2.95 ms.
        assert!(number(&summary, "/hops/wire/p50_ns") > 5.0e6, "framing takes time on the wire");
    }
}

/// The cameras would show its vehicle, or its truth would be recorded, while the one at the link flies.
#[test]
fn a_flight_at_a_link_is_refused_beside_a_simulator() {
    let testbed = Testbed::new("link");
    let bus = testbed.bus();
    let (vehicle, link) = waiting_vehicle(&testbed);
    wait_for("the simulator", || bus.holder(&Role::Plant.health()).unwrap());
    let link = format!("link:{link}");
    let flight = ["fly", "--vehicle", &link];
    for cameras in [&[][..], &["--mocap", "link:qtm:127.0.0.1,body=quad"]] {
        let words = [&flight[..], cameras].concat();
        testbed.refuses(&words, 75, &["`oqtal plant-sim` (", "already runs on instance"]);
    }
    vehicle.signal(Signal::TERM);
    assert!(vehicle.wait().status.success());
    assert!(!testbed.path("vehicle").exists(), "the link goes with its vehicle");
}

/// On the bench the vehicle is at another place; a simulated shadow supplies the truth for the cameras.
#[test]
fn on_the_bench_a_shadow_stands_in_for_the_truth() {
    let (bench, elsewhere) = (Testbed::new("bench"), Testbed::new("elsewhere"));
    let (_vehicle, link) = waiting_vehicle(&elsewhere);
    let vehicle = format!("link:{link}");
    let settings = ["safety.allow-emulated-poses=true", "bridge.vehicle-time-out-ms=1000"];
    let words = ["--vehicle", &vehicle, "--set", settings[0], "--set", settings[1]];
    let summary = bench.lands(&[&words, &hover("1")[..]].concat());
    assert_eq!(summary["error_source"], "pose");
    assert!(summary["trajectory_hash"].is_null());
}

#[test]
fn a_silent_vehicle_ends_the_flight_with_a_remedy() {
    let testbed = Testbed::new("silent");
    // A terminal without a reader at the far end.
    let near =
        rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR | rustix::pty::OpenptFlags::NOCTTY);
    let near = near.unwrap();
    rustix::pty::unlockpt(&near).unwrap();
    let far = rustix::pty::ptsname(&near, Vec::new()).unwrap().into_string().unwrap();
    let words = ["fly", "--vehicle", &format!("link:asctec:{far}"), "--duration", "2"];
    testbed.refuses(&words, 75, &["does not answer", "channel 5"]);
}

#[test]
fn bad_use_of_a_wire_has_its_exit_code_and_message() {
    let testbed = Testbed::new("wires");
    let refused = |words: &[&str], code: i32, part: &str| {
        testbed.refuses(&[&["fly"], words].concat(), code, &[part]);
    };
    for clock in ["lockstep", "in-process"] {
        refused(&["--vehicle", "bridge:asctec", "--clock", clock], 64, "leave out --clock");
        refused(
            &["--vehicle", "link:asctec:/dev/ttyS9", "--clock", clock],
            64,
            "leave out --clock",
        );
    }
    refused(&["--vehicle", "bridge:dsmx"], 64, "bridge:asctec");
    refused(&["--vehicle", "link:asctec:/dev/nowhere"], 71, "/dev/nowhere");
}

/// Exit codes of the plant for an existing file at the path of its link.
#[test]
fn a_stale_link_is_replaced_and_anything_else_is_left_alone() {
    let testbed = Testbed::new("stale");
    let path = testbed.path("vehicle");
    let link = format!("asctec:{}", path.display());
    let words = ["plant-sim", "run", "--wire", &link];

    std::fs::write(&path, "not a link").unwrap();
    testbed.refuses(&words, 78, &["remove it"]);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "not a link");
    std::fs::remove_file(&path).unwrap();

    let (killed, _) = waiting_vehicle(&testbed);
    let terminal = std::fs::read_link(&path).unwrap();
    Testbed::new("second").refuses(&words, 75, &[&killed.id().to_string()]);
    assert_eq!(std::fs::read_link(&path).unwrap(), terminal, "the first is undisturbed");

    killed.signal(Signal::KILL);
    killed.wait();
    assert!(std::fs::symlink_metadata(&path).is_ok(), "a killed one leaves its link");
    let (_vehicle, _) = waiting_vehicle(&testbed);
}

#[test]
fn latency_of_a_running_bridge_has_the_hop_of_the_wire() {
    let testbed = Testbed::new("attach");
    let flight = testbed.start(&[&["fly"], &WIRED[..], &hover("20")].concat());
    let figures = wait_for("a flight in the air", || {
        let output =
            testbed.oqtal(&["latency", "--attach", "--seconds", "2", "--json"]).output().unwrap();
        let figures: Value = serde_json::from_slice(&output.stdout).ok()?;
        (figures.pointer("/hops/wire/count")?.as_u64()? > 60).then_some(figures)
    });
    assert!((2.9e6..3.1e6).contains(&number(&figures, "/hops/wire/p50_ns")));
    flight.signal(Signal::INT);
    flight.signal(Signal::INT);
    flight.wait();
}

/// Both ends of the wire are configured with the delay of the direct simulation.
#[test]
fn the_delay_over_the_wire_is_that_of_the_direct_simulation() {
    let config = Config::default();
    let command_ms = 1e3 * 17.0 * 10.0 / 57_600.0;
    for latency_ms in [config.plant.wire.latency_ms, config.bridge.air_latency_ms] {
        let whole = latency_ms + command_ms;
        assert!((whole - config.plant.command_delay_ms).abs() < 0.1, "{whole} ms");
    }
}

/// Starts an emulated vehicle on `testbed`; returns it and its link.
fn waiting_vehicle(testbed: &Testbed) -> (Running, String) {
    let path = testbed.path("vehicle");
    let stale = std::fs::read_link(&path).ok();
    let link = format!("asctec:{}", path.display());
    let running = testbed.start(&["plant-sim", "run", "--wire", &link]);
    wait_for("the link", || {
        let fresh = path.exists() && std::fs::read_link(&path).ok() != stale;
        // The number of the terminal may be reused; then the lock shows that the process is ready.
        let same = path.exists() && stale.is_some() && locked(&path);
        (fresh || same).then_some(())
    });
    (running, link)
}

fn locked(path: &std::path::Path) -> bool {
    let Ok(far) = std::fs::File::options().read(true).write(true).open(path) else { return false };
    let lock = rustix::process::Flock::from(rustix::process::FlockType::WriteLock);
    rustix::process::fcntl_getlk(&far, &lock).is_ok_and(|holder| holder.is_some())
}
