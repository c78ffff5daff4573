//! The same flight with each clock: real, lockstep, in-process.

use crate::common::{Testbed, json, number, signal, state_of, wait_for};
use oqtal_bus::time::Span;
use oqtal_bus::topic::{TELEMETRY, TRUTH};
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

/// Arguments of a short flight.
const SHORT: [&str; 4] = ["--trajectory", "hover", "--duration", "3"];

fn hash(clock: &str, seed: &str, more: &[&str]) -> String {
    let words = [&["--clock", clock, "--seed", seed], more].concat();
    let summary = Testbed::new("clocks").lands(&words);
    summary["trajectory_hash"].as_str().unwrap().to_owned()
}

#[test]
fn lockstep_repeats_and_agrees_with_in_process_bit_for_bit() {
    let first = hash("lockstep", "7", &[]);
    assert_eq!(first, hash("lockstep", "7", &[]));
    assert_eq!(first, hash("in-process", "7", &[]));
    assert_ne!(first, hash("in-process", "8", &[]));
}

#[test]
fn the_clocks_agree_with_every_law_camera_and_vehicle() {
    for words in [
        &["--controller", "pid", "--set", "mocap.preset=measured"][..],
        &["--controller", "oqtal-dt", "--set", "mocap.preset=measured"],
        &["--controller", "lqr", "--set", "mocap.rate-hz=240"],
        &["--vehicle", "sim:hummingbird,fidelity=rotors", "--set", "plant.battery.sag=true"],
        &["--vehicle", "sim:spacecraft", "--set", "mocap.latency-ms=0"],
        &["--controller", "oqtal-dt", "--set", "vehicle.interface=attitude"],
    ] {
        let words = [&SHORT[..], words].concat();
        assert_eq!(hash("lockstep", "3", &words), hash("in-process", "3", &words), "{words:?}");
    }
}

#[test]
fn lockstep_stands_still_while_the_daemon_is_stopped_and_continues_after() {
    let testbed = Testbed::new("standstill");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut truth = bus.observer(&TRUTH).unwrap();
    let long =
        ["fly", "--clock", "lockstep", "--trajectory", "hover", "--duration", "600", "--json"];
    let flight = testbed.start(&long);
    let daemon = wait_for("the daemon", || {
        telemetry.receive().unwrap().map(|(header, _)| header.origin().process())
    });
    signal(daemon, Signal::STOP);
    wait_for("the daemon to stop", || (state_of(daemon) == Some('T')).then_some(()));
    // The last tick of the daemon, and the latest instant at which its next one could be due.
    let mut last = None;
    while let Some((_, tick)) = telemetry.receive().unwrap() {
        last = Some(tick.time);
    }
    let limit = last.map(|last| last + Span::from_millis(26));
    // Another flight with thousands of events takes long enough for this one to advance if it could.
    Testbed::new("yardstick").summary(&[&SHORT[..], &["--clock", "lockstep"]].concat());
    let still = truth.latest().unwrap().map(|(_, truth)| truth.time);
    assert!(limit.is_none_or(|limit| still <= Some(limit)), "{still:?} without the daemon");
    assert!(telemetry.latest().unwrap().is_none(), "a stopped daemon published telemetry");
    signal(daemon, Signal::CONT);
    wait_for("time to continue", || {
        truth.latest().unwrap().filter(|(_, truth)| Some(truth.time) > limit.max(still))
    });
    let summary = json(&flight.wait());
    assert_eq!(summary["outcome"], "landed");
    assert!(number(&summary, "/duration_s") > 600.0);
}

#[test]
fn a_real_time_flight_lands_and_accounts_for_every_hop() {
    let testbed = Testbed::new("real");
    let summary = testbed.lands(&SHORT);
    let count = |hop| number(&summary, &format!("/hops/{hop}/count"));
    assert!(count("compute") > 300.0);
    assert_eq!(count("compute"), count("sensor_to_actuator"));
    // The delay of the radio is simulated and therefore exact also with the real clock.
    assert!((number(&summary, "/hops/vehicle_to_applied/p50_ns") / 20e6 - 1.0).abs() < 0.01);
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

/// In lockstep, where a message of the other instance would change the flight, and the processor has no influence.
#[test]
fn two_instances_fly_side_by_side() {
    let seeds = ["5", "6"];
    let flights = seeds.map(|seed| {
        let testbed = Testbed::new("side");
        let words = ["fly", "--json", "--clock", "lockstep", "--seed", seed];
        (testbed.start(&[&words[..], &SHORT].concat()), testbed)
    });
    for (seed, (flight, _testbed)) in seeds.into_iter().zip(flights) {
        let summary = json(&flight.wait());
        assert_eq!(summary["trajectory_hash"], hash("in-process", seed, &SHORT), "{summary:#}");
    }
}
