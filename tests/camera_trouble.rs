//! Flights as processes whose poses come over a network in trouble: flown on or stopped, as docs/faults.md says.

mod common;
#[path = "receiver/network.rs"]
mod network;

use std::process::{Command, Output};
use std::time::Duration;

use common::{Running, Testbed, number, stderr, wait_for};
use network::{Network, free_port, ip};
use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::port::Reader;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use serde_json::Value;

/// A hover that takes off, stays and lands.
const HOVER: [&str; 5] = ["--trajectory", "hover", "--duration", "1", "--json"];
/// One frame of a hundred is lost, one comes twice, one comes after the next.
const TROUBLE: [&str; 6] = [
    "--set",
    "mocap.serve.loss-probability=0.01",
    "--set",
    "mocap.serve.repeat-probability=0.01",
    "--set",
    "mocap.serve.swap-probability=0.01",
];

fn summary(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

/// Waits for a tick in this state of flight.
fn wait_for_tick(
    what: &str,
    telemetry: &mut Reader<TelemetryV1>,
    mut is_it: impl FnMut(&TelemetryV1) -> bool,
) {
    wait_for(what, || {
        while let Some((_, tick)) = telemetry.receive().unwrap() {
            if is_it(&tick) {
                return Some(());
            }
        }
        None
    });
}

fn is_in(state: SafetyState) -> impl Fn(&TelemetryV1) -> bool {
    move |tick| tick.state == state.code()
}

#[test]
fn f50_frames_lost_doubled_and_overtaken_are_flown_through() {
    let testbed = Testbed::new("trouble");
    let log = testbed.path("flight/receiver.log");
    let flight = ["--mocap", "natnet", "--out", "flight"];
    let summary = testbed.summary(&[&flight[..], &HOVER[..4], &TROUBLE].concat());
    assert_eq!(summary["outcome"], "landed", "{summary}");
    let said = std::fs::read_to_string(log).unwrap();
    assert!(said.contains("frames of the last seconds"), "{said}");
}

#[test]
fn f54_a_camera_server_that_dies_in_flight_ends_it() {
    let testbed = Testbed::new("server-dies");
    // It comes back, but its clock has to be learned: no pose for more than half a second.
    let flight = ["fly", "--mocap", "qtm", "--fault", "mocap-emu:kill@2+0.1"];
    let output = testbed.oqtal(&[&flight[..], &HOVER].concat()).output().unwrap();
    let summary = summary(&output);
    assert_eq!(summary["outcome"], "stopped", "{summary}");
    assert!(number(&summary, "/hops/receive_to_publish/count") > 60.0, "{summary}");
}

#[test]
fn squares_in_a_room_whose_connection_stalls_land() {
    let testbed = Testbed::new("stalls");
    for seed in ["1", "4", "7"] {
        let flight = ["--clock", "in-process", "--trajectory", "square", "--seed", seed];
        let room = ["--set", "mocap.preset=room"];
        let summary = testbed.summary(&[&flight[..], &room].concat());
        assert_eq!(summary["outcome"], "landed", "{seed}: {summary}");
    }
}

/// The world of a linked flight: a vehicle at a serial port, and cameras that serve what they see, in trouble.
fn world(testbed: &Testbed) -> (Vec<Running>, String, String) {
    let (port, radio) = (free_port(), testbed.path("radio"));
    let vehicle = format!("asctec:{}", radio.display());
    let plant =
        testbed.start(&["plant-sim", "run", "--set", &format!("plant.wire.link={vehicle}")]);
    let served = format!("natnet:{port}");
    let cameras = [&["mocap-emu", "run", "--serve", &served][..], &TROUBLE].concat();
    let cameras = testbed.start(&cameras);
    wait_for("the port of the vehicle", || radio.exists().then_some(()));
    let link = format!("link:natnet:127.0.0.1:{port},body=quad");
    (vec![plant, cameras], link, format!("link:{vehicle}"))
}

#[test]
fn a_vehicle_at_a_link_seen_by_cameras_at_a_link_flies_and_lands() {
    let (there, here) = (Testbed::new("world"), Testbed::new("linked"));
    let (_processes, cameras, vehicle) = world(&there);
    // The cameras answer once they see the vehicle.
    let probe = ["receiver", "probe", &cameras["link:".len()..], "--seconds", "1", "--json"];
    wait_for("the cameras", || here.oqtal(&probe).output().unwrap().status.success().then_some(()));
    let summary =
        here.summary(&[&["--mocap", &cameras, "--vehicle", &vehicle][..], &HOVER[..4]].concat());
    assert_eq!(summary["outcome"], "landed", "{summary}");
    assert_eq!(summary["error_source"], "pose", "{summary}");
    assert!(number(&summary, "/hops/capture_to_receive/count") > 100.0, "{summary}");
}

#[test]
fn f56_a_cable_pulled_for_a_moment_is_flown_through_and_for_longer_ends_the_flight() {
    let Some(network) = Network::alone() else { return };
    let testbed = Testbed::new("cable-flight");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let flight = ["fly", "--mocap", "qtm", "--trajectory", "hover", "--duration", "60", "--json"];
    let inner = testbed.oqtal(&flight);
    let mut command = Command::new("ip");
    command.args(["netns", "exec", network.name()]).arg(inner.get_program());
    command.args(inner.get_args()).current_dir(testbed.path("."));
    let flight = Running::start(&mut command);
    let flying = |tick: &TelemetryV1| {
        tick.mode == Mode::Flying.code() && tick.tick > 180 && is_in(SafetyState::Nominal)(tick)
    };
    wait_for_tick("a flight", &mut telemetry, flying);
    let cable = |state: &str| assert!(ip(&["-n", network.name(), "link", "set", "lo", state]));
    cable("down");
    std::thread::sleep(Duration::from_millis(60));
    cable("up");
    // A second of flight.
    let mut ticks = 0;
    wait_for_tick("a flight that goes on", &mut telemetry, |tick| {
        assert_ne!(tick.state, SafetyState::Stop.code(), "{tick:?}");
        ticks += u32::from(tick.state == SafetyState::Nominal.code());
        ticks == 60
    });
    cable("down");
    wait_for_tick("the Stop", &mut telemetry, is_in(SafetyState::Stop));
    assert_eq!(summary(&flight.wait())["outcome"], "stopped");
}
