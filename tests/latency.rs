//! `oqtal latency`: its figures, its effect on a running flight, and its cleanup.

use std::path::Path;

use crate::common::{
    Running, Testbed, assert_refused, children, is_alive, is_root, json, number, skipped, stderr,
    wait_for,
};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::Mode;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;
use serde_json::Value;

const HOPS: [&str; 6] = [
    "capture_to_publish",
    "publish_to_daemon",
    "compute",
    "command_to_vehicle",
    "vehicle_to_applied",
    "sensor_to_actuator",
];
const BARE: [&str; 5] = ["futex", "eventfd", "unix_datagram", "udp_socket", "iceoryx2_listener"];
/// Ordinary scheduling: tests run in parallel on one machine.
const ORDINARY: [&str; 2] = ["--set", "realtime.scheduling=other"];

/// Starts `oqtal latency` in an environment without cyclictest.
fn measure(testbed: &Testbed, words: &[&str]) -> Running {
    let words = [&["latency", "--json"], &ORDINARY[..], words].concat();
    let mut command = testbed.oqtal(&words);
    Running::start(command.env("PATH", ""))
}

fn figures(output: &std::process::Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    json(output)
}

/// Names in shared memory left by a measurement of the process `pid`.
fn remains(pid: u32) -> Vec<String> {
    let entries = std::fs::read_dir("/dev/shm").unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    let own = [format!("latency-{pid}"), format!("_b-{pid}_")];
    names.filter(|name| own.iter().any(|own| name.contains(own))).collect()
}

/// Name of the instance of the measurement by the process `pid`; it ends with a random number.
fn instance_of(testbed: &Testbed, pid: u32) -> String {
    let entries = std::fs::read_dir(testbed.path("run")).unwrap().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.into_iter().find(|name| name.starts_with(&format!("latency-{pid}-"))).unwrap()
}

fn paths_of(testbed: &Testbed, instance: &str) -> InstancePaths {
    InstancePaths::new(instance, Some(&testbed.path("run"))).unwrap()
}

#[test]
fn the_chain_at_rest_is_measured_beside_the_bare_mechanisms_in_one_run() {
    let testbed = Testbed::new("rest");
    let running = measure(&testbed, &["--seconds", "2"]);
    let pid = running.id();
    let output = running.wait();
    let figures = figures(&output);
    let count = |path: &str| number(&figures, &format!("/{path}/count"));
    for hop in HOPS {
        // Every hop and their sum have the same number of samples.
        assert_eq!(count(&format!("hops/{hop}")), count("hops/sensor_to_actuator"), "{hop}");
    }
    assert!(count("hops/compute") > 60.0);
    for name in BARE {
        assert!(count(&format!("bare/{name}")) > 60.0, "{name}");
        let at = |key: &str| number(&figures, &format!("/bare/{name}/{key}"));
        assert!(at("min_ns") > 0.0 && at("min_ns") <= at("p50_ns"), "{name}");
        assert!(at("p50_ns") <= at("p99_ns") && at("p99_ns") <= at("p999_ns"), "{name}");
    }
    for hop in ["publish_to_daemon", "command_to_vehicle"] {
        let p50 = |part: &str, name: &str| number(&figures, &format!("/{part}/{name}/p50_ns"));
        let ratio = p50("hops", hop) / p50("bare", "iceoryx2_listener");
        assert!((number(&figures, &format!("/ratio/{hop}/p50")) - ratio).abs() < 1e-9, "{hop}");
        number(&figures, &format!("/ratio/{hop}/p99"));
    }
    let conditions: Vec<&str> =
        (0..3).filter_map(|k| figures["conditions"][k]["condition"].as_str()).collect();
    let names = ["with warm-up", "without warm-up", "with warm-up, cameras that jitter"];
    assert_eq!(conditions, names);
    for (k, name) in names.iter().enumerate() {
        for hop in ["publish_to_daemon", "command_to_vehicle"] {
            let ratio = number(&figures, &format!("/conditions/{k}/ratio/{hop}/p50"));
            assert!(ratio > 0.0, "{name}: {hop}");
        }
    }
    assert_eq!(figures["realtime"]["policy"], "other");
    number(&figures, "/counters/commands_lost");
    // Without cyclictest there is a message and no comparison.
    assert!(stderr(&output).contains("cyclictest is not installed"), "{}", stderr(&output));
    assert_eq!(figures["wakeup"]["pairs"], serde_json::json!([]));
    assert!(figures["wakeup"]["median_ratio"].is_null());
    assert!(remains(pid).is_empty(), "{:?}", remains(pid));
}

#[test]
fn the_wire_is_observed_by_root_alone() {
    if is_root() {
        return skipped("this test is of a user without CAP_NET_RAW");
    }
    let testbed = Testbed::new("wire");
    let output = measure(&testbed, &["--wire", "--seconds", "1"]).wait();
    assert_refused(&output, 77, &["CAP_NET_RAW", "as root"]);
}

#[test]
fn attaching_without_an_instance_is_refused() {
    let testbed = Testbed::new("nobody");
    let output = measure(&testbed, &["--attach", "--seconds", "1"]).wait();
    assert_refused(&output, 75, &[testbed.instance()]);
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

#[test]
fn an_observed_flight_is_measured_and_lands() {
    let testbed = Testbed::new("observed");
    let bus: Bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let words = ["fly", "--trajectory", "hover", "--duration", "60", "--json"];
    let flight = testbed.start(&[&words[..], &ORDINARY].concat());
    wait_for("take-off", || {
        telemetry.latest().unwrap().filter(|(_, t)| t.mode == Mode::Flying.code())
    });
    let attached = figures(&measure(&testbed, &["--attach", "--seconds", "2"]).wait());
    for hop in HOPS {
        assert!(number(&attached, &format!("/hops/{hop}/count")) > 0.0, "{hop}");
    }
    // The hop includes the delay of the simulated radio.
    let radio = number(&attached, "/hops/vehicle_to_applied/p50_ns");
    assert!((radio / 20e6 - 1.0).abs() < 0.05, "{radio}");
    assert!(number(&attached, "/counters/ticks") > 0.0);
    assert_eq!(attached["bare"], serde_json::json!({}));
    assert_eq!(attached["ratio"], serde_json::json!({}));
    flight.signal(Signal::INT);
    let summary = figures(&flight.wait());
    assert_eq!(summary["outcome"], "landed");
}

#[test]
fn an_interrupted_measurement_prints_its_figures_and_leaves_nothing() {
    let testbed = Testbed::new("interrupted");
    let running = measure(&testbed, &["--seconds", "600"]);
    let pid = running.id();
    wait_for("the chain and the bare mechanisms", || (children(pid).len() == 8).then_some(()));
    // Two seconds of samples.
    let bus = Bus::open(&paths_of(&testbed, &instance_of(&testbed, pid))).unwrap();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("a hover", || {
        telemetry.latest().unwrap().filter(|(_, t)| t.mode == Mode::Flying.code() && t.tick > 120)
    });
    drop((telemetry, bus));
    running.signal(Signal::INT);
    let figures = figures(&running.wait());
    assert!(number(&figures, "/hops/compute/count") > 0.0);
    assert!(remains(pid).is_empty(), "{:?}", remains(pid));
}

#[test]
fn a_killed_measurement_leaves_no_orphans() {
    let testbed = Testbed::new("killed");
    let running = measure(&testbed, &["--seconds", "600"]);
    let pid = running.id();
    let started =
        wait_for("its processes", || Some(children(pid)).filter(|children| children.len() == 8));
    let instance = instance_of(&testbed, pid);
    running.signal(Signal::KILL);
    for child in started {
        wait_for("an orphan to end", || (!is_alive(child)).then_some(()));
    }
    // A killed process does not clean up; the next process that joins does.
    for name in [&instance, &format!("b-{pid}")] {
        drop(Bus::open(&paths_of(&testbed, name)).unwrap());
    }
    std::fs::remove_dir_all(Path::new("/dev/shm").join(format!("oqtal-{instance}"))).unwrap();
    assert!(remains(pid).is_empty(), "{:?}", remains(pid));
}

#[test]
fn a_daemon_that_ends_meanwhile_ends_the_measurement_with_its_figures_until_then() {
    let testbed = Testbed::new("ends");
    let [_plant, _cameras, daemon] = testbed.services();
    testbed.wait_for_daemon();
    let mut command = testbed.oqtal(&["latency", "--attach", "--json", "--seconds", "3000"]);
    let measurement = Running::start(&mut command);
    // The measurement has begun.
    wait_for("an observer", || {
        let fds = std::fs::read_dir(format!("/proc/{}/fd", measurement.id())).ok()?;
        (fds.count() > 20).then_some(())
    });
    let mut telemetry = testbed.bus().observer(&TELEMETRY).unwrap();
    let mut ticks = 0;
    wait_for("ticks", || {
        ticks += u32::from(telemetry.receive().unwrap().is_some());
        (ticks > 120).then_some(())
    });
    daemon.signal(Signal::TERM);
    daemon.wait();
    let output = measurement.wait();
    assert_refused(&output, 75, &["the daemon ended after", "until then"]);
    let figures = json(&output);
    assert!(!figures["realtime"]["policy"].as_str().unwrap().is_empty(), "{figures}");
    assert!(number(&figures, "/measured_s") < 60.0);
}
