//! Flights through processes with poses over a faulty network: they continue or stop as stated in docs/faults.md.

use crate::common::network::free_port;
use crate::common::{Running, Testbed, json, number, wait_for};

/// A short hover, from take-off to landing.
const HOVER: [&str; 5] = ["--trajectory", "hover", "--duration", "1", "--json"];
/// 1 % of frames lost, 1 % repeated, 1 % delivered after their successors.
const TROUBLE: [&str; 6] = [
    "--set",
    "mocap.serve.loss-probability=0.01",
    "--set",
    "mocap.serve.repeat-probability=0.01",
    "--set",
    "mocap.serve.swap-probability=0.01",
];

#[test]
fn f50_frames_lost_doubled_and_overtaken_are_flown_through() {
    let testbed = Testbed::new("trouble");
    let log = testbed.path("flight/receiver.log");
    let flight = ["--mocap", "natnet", "--out", "flight"];
    testbed.lands(&[&flight[..], &HOVER[..4], &TROUBLE].concat());
    let said = std::fs::read_to_string(log).unwrap();
    assert!(said.contains("frames of the last seconds"), "{said}");
}

#[test]
fn f54_a_camera_server_that_dies_in_flight_ends_it() {
    let testbed = Testbed::new("server-dies");
    // The camera system returns, but its clock must be estimated again: no pose for more than half a second.
    let flight = ["fly", "--mocap", "qtm", "--fault", "mocap-emu:kill@2+0.1"];
    let output = testbed.oqtal(&[&flight[..], &HOVER].concat()).output().unwrap();
    let summary = json(&output);
    assert_eq!(summary["outcome"], "stopped", "{summary}");
    assert!(number(&summary, "/hops/receive_to_publish/count") > 60.0, "{summary}");
}

#[test]
fn squares_in_a_room_whose_connection_stalls_land() {
    let testbed = Testbed::new("stalls");
    for seed in ["1", "4", "7"] {
        let flight = ["--clock", "in-process", "--trajectory", "square", "--seed", seed];
        let room = ["--set", "mocap.preset=room"];
        testbed.lands(&[&flight[..], &room].concat());
    }
}

/// Far end of a linked flight: a vehicle at a serial port, and cameras that serve their poses over a faulty network.
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
    let time_out = "bridge.vehicle-time-out-ms=1000";
    let links = ["--mocap", &cameras, "--vehicle", &vehicle, "--set", time_out];
    let summary = here.lands(&[&links[..], &HOVER[..4]].concat());
    assert_eq!(summary["error_source"], "pose", "{summary}");
    assert!(number(&summary, "/hops/capture_to_receive/count") > 100.0, "{summary}");
}
