//! Crazyflies: several on one radio in virtual time, and as processes over UDP.

mod air;
mod laboratory;

use std::net::UdpSocket;
use std::time::Duration;

use crate::common::network::free_port;
use crate::common::{
    TWO_CORNERS, Testbed, assert_as_good_as, assert_refused, number, peers, stderr, wait_for,
};
use laboratory::{Laboratory, configuration};
use oqtal_bridge::Note;
use oqtal_bus::code::VehicleRefusal;
use oqtal_bus::topic::Role;
use oqtal_plant_sim::wire::CrtpVehicle;
use oqtal_wire::crazyflie_sitl::HELLO;
use oqtal_wire::crtp::{CrtpRequest, Supervision, SupervisorCommand};
use rustix::process::Signal;

/// Flies `count` vehicles for ten seconds at a height of a metre; returns the laboratory.
fn flown(count: usize, loss: f64) -> Laboratory {
    let mut laboratory = Laboratory::new(&configuration(), count, loss);
    laboratory.pass(4000);
    laboratory.command(true);
    laboratory.pass(14_000);
    laboratory
}

#[test]
fn two_crazyflies_on_one_radio_fly_at_sixty_hertz_within_its_budget() {
    let mut laboratory = flown(2, 0.0);
    let before = [0, 1].map(|vehicle| laboratory.counts(vehicle));
    laboratory.pass(10_000);
    for (vehicle, before) in before.into_iter().enumerate() {
        let after = laboratory.counts(vehicle);
        let rate = |after: u64, before: u64| (after - before) as f64 / 10.0;
        let (packets, setpoints) =
            (rate(after.sent, before.sent), rate(after.setpoints, before.setpoints));
        println!("vehicle {vehicle}: {packets} packets/s, of them {setpoints} set-points");
        assert!((59.5..60.5).contains(&setpoints), "{setpoints} set-points a second");
        assert!(packets <= 250.0 + setpoints, "{packets} packets a second");
        assert!(after.dropped - before.dropped == 0, "{after:?}");
        let height = laboratory.truth(vehicle).position[2];
        assert!((height - 1.0).abs() < 0.02, "{height} m");
    }
}

#[test]
fn poses_of_two_crazyflies_in_one_packet_leave_the_radio_free_and_both_estimate_their_positions() {
    let mut laboratory = Laboratory::new(&configuration(), 2, 0.0);
    laboratory.pack_poses();
    laboratory.pass(4000);
    laboratory.command(true);
    laboratory.pass(14_000);
    let before = [0, 1].map(|vehicle| laboratory.counts(vehicle));
    laboratory.pass(10_000);
    let mut packed = 0;
    for (vehicle, before) in before.into_iter().enumerate() {
        let after = laboratory.counts(vehicle);
        packed += after.packed - before.packed;
        assert!((595..=605).contains(&(after.setpoints - before.setpoints)), "{after:?}");
        let height = laboratory.truth(vehicle).position[2];
        assert!((height - 1.0).abs() < 0.02, "{height} m");
        let estimated = laboratory.estimate(vehicle);
        assert!((estimated[2] - height).abs() < 0.01, "{estimated:?}, at {height} m");
    }
    println!("{packed} poses shared a packet");
    assert!(packed > 400, "{packed} poses");
}

#[test]
fn two_crazyflies_fly_on_where_one_transmission_of_ten_is_lost_and_land() {
    let mut laboratory = flown(2, 0.1);
    for vehicle in 0..2 {
        let height = laboratory.truth(vehicle).position[2];
        assert!((height - 1.0).abs() < 0.05 && laboratory.motors_run(vehicle), "{height} m");
    }
    laboratory.command(false);
    laboratory.pass(7000);
    for vehicle in 0..2 {
        assert!(!laboratory.motors_run(vehicle), "disarmed after it no longer counts as flying");
        let bits = laboratory.air.borrow().vehicles[vehicle].board().supervision();
        assert!(bits.contains(Supervision::CAN_BE_ARMED) && !bits.contains(Supervision::LOCKED));
    }
    laboratory.command(true);
    laboratory.pass(5000);
    assert!(laboratory.motors_run(0) && laboratory.motors_run(1), "a second flight");
}

#[test]
fn f66_a_locked_crazyflie_is_not_flown_and_a_restart_is_requested() {
    let mut laboratory = flown(1, 0.0);
    let stop = CrtpRequest::Supervisor(SupervisorCommand::EmergencyStop);
    let now = laboratory.air.borrow().now;
    laboratory.air.borrow_mut().vehicles[0].host_writes(now, stop.packet().as_bytes());
    laboratory.pass(2000);
    assert!(!laboratory.motors_run(0));
    let locked = |note: &&Note| **note == Note::Refused(VehicleRefusal::Locked);
    assert_eq!(laboratory.notes.iter().filter(locked).count(), 1);
    let says = |note: &Note| matches!(note, Note::Text(said) if said.is_trouble);
    let texts = laboratory.notes.iter().filter(|note| says(note)).count();
    assert_eq!(texts, 1, "{:?}", laboratory.notes);
    assert_eq!(laboratory.refusal(0), Some(VehicleRefusal::Locked));
    let fresh = CrtpVehicle::new(&configuration(), laboratory.air.borrow().now).unwrap();
    laboratory.air.borrow_mut().vehicles[0] = fresh;
    laboratory.command(false);
    laboratory.pass(6000);
    assert_eq!(laboratory.refusal(0), Some(VehicleRefusal::None), "restarted");
}

#[test]
fn f72_a_crazyflie_is_reported_as_not_set_up_until_its_tables_are_read() {
    let mut laboratory = Laboratory::new(&configuration(), 1, 0.0);
    laboratory.pass(200);
    assert_eq!(laboratory.refusal(0), Some(VehicleRefusal::NotSetUp));
    laboratory.pass(4000);
    assert_eq!(laboratory.refusal(0), Some(VehicleRefusal::None));
}

#[test]
fn f67_a_crazyflie_that_restarts_is_set_up_again_before_it_flies() {
    let mut laboratory = flown(1, 0.0);
    let start = laboratory.air.borrow().now;
    let fresh = CrtpVehicle::new(&configuration(), start).unwrap();
    laboratory.air.borrow_mut().vehicles[0] = fresh;
    laboratory.pass(6000);
    assert_eq!(laboratory.truth(0).position[2], 0.0, "no flight was requested since");
    laboratory.command(false);
    laboratory.pass(3000);
    laboratory.command(true);
    laboratory.pass(6000);
    let truth = laboratory.truth(0);
    assert!(truth.position[2] > 0.8, "{truth:?}");
    assert!(truth.rate.iter().all(|rate| rate.abs() < 0.05), "by rates, not by angles: {truth:?}");
}

#[test]
fn a_square_over_crtp_is_as_good_as_the_direct_simulation() {
    let testbed = Testbed::new("crtp");
    let flown = testbed.lands(&[&["--vehicle", "bridge:crtp"], &TWO_CORNERS[..]].concat());
    assert_eq!(flown["vehicle"], "bridge:crtp");
    let direct = ["--vehicle", "sim:crazyflie-2.1", "--clock", "in-process"];
    let direct = testbed.summary(&[&direct[..], &TWO_CORNERS].concat());
    assert_as_good_as(&flown, &direct);
    assert!(number(&flown, "/wire/link_quality/mean") > 0.95);
}

#[test]
fn bad_use_of_a_crazyflie_has_its_exit_code_and_message() {
    let testbed = Testbed::new("crtp-wrong");
    let refused = |words: &[&str], code: i32, part: &str| testbed.refuses(words, code, &[part]);
    let preset = ["--set", "vehicle.preset=crazyflie-2.1"];
    let bridge = |link| [&["bridge", "run", "--link", link], &preset[..]].concat();
    refused(&bridge("crtp:radio:80/2M/E7E7E7E7E7"), 71, "no Crazyradio is plugged in");
    refused(&bridge("crtp:radio:80"), 78, "CHANNEL/RATE/ADDRESS");
    refused(
        &["bridge", "run", "--link", "crtp:udp:127.0.0.1:19850"],
        78,
        "vehicle.preset = \"crazyflie-2.1\"",
    );
    refused(
        &["plant-sim", "run", "--wire", "crtp:radio:80/2M/E7E7E7E7E7"],
        78,
        "--wire crtp:udp:HOST:PORT",
    );
    let holder = UdpSocket::bind("127.0.0.1:0").unwrap();
    let link = format!("crtp:udp:{}", holder.local_addr().unwrap());
    refused(&["plant-sim", "run", "--wire", &link], 75, "name another port");
    // The radio does not belong to an instance.
    let shared = ["bridge", "radio", "--vehicle", "80/2M/E7E7E7E701@127.0.0.1:0"];
    let output = testbed.study(&shared).output().unwrap();
    assert_refused(&output, 71, &["no Crazyradio is plugged in"]);
    assert!(!stderr(&output).contains("--link"), "{}", stderr(&output));
}

#[test]
fn f25_a_second_bridge_at_the_same_vehicle_is_refused_on_any_instance() {
    let [first, second] = ["first-bridge", "second-bridge"].map(Testbed::new);
    let link = format!("crtp:udp:127.0.0.1:{}", free_port());
    let bridge = ["bridge", "run", "--link", &link, "--set", "vehicle.preset=crazyflie-2.1"];
    let _bridge = first.start(&bridge);
    wait_for("the first bridge", || first.bus().holder(&Role::Bridge.health()).unwrap());
    second.refuses(&bridge, 75, &["is used by another process"]);
}

/// The firmware announces itself and sends nothing else, as the one of 2024 in some of its starts.
#[test]
fn a_firmware_that_hangs_in_its_start_ends_the_flight_with_a_remedy() {
    let testbed = Testbed::new("firmware-hangs");
    let [body, crtp] = [free_port(), free_port()].map(|port| format!("127.0.0.1:{port}"));
    let firmware = UdpSocket::bind("127.0.0.1:0").unwrap();
    firmware.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let starts = || {
        let _ = firmware.send_to(&HELLO, &body);
        firmware.recv(&mut [0; 64]).ok()
    };
    let (link, truth) =
        (format!("link:crtp:udp:{crtp}"), format!("crazyflie-sitl:udp:{body},crtp={crtp}"));
    let out = testbed.path("out").display().to_string();
    let words = ["fly", "--vehicle", &link, "--truth", &truth, "--duration", "2", "--out", &out];
    let words = [&words[..], &["--set", "vehicle.preset=crazyflie-2.1"]].concat();
    std::thread::scope(|threads| {
        threads.spawn(|| wait_for("the body", starts));
        testbed.refuses(&words, 75, &["does not answer", "start it again", "plant-sim.log"]);
    });
    let log = |name| std::fs::read_to_string(testbed.path("out").join(name)).unwrap();
    let plant = log("plant-sim.log");
    assert!(plant.contains("does not calibrate its sensors: start it again"), "{plant}");
    assert!(!log("daemon.log").contains("in flight"), "it never took off");
}

/// cflib 0.1.34 connects to the emulated vehicle, reads both tables, sets parameters, reads log data, arms and flies it.
#[test]
fn cflib_flies_the_emulated_vehicle() {
    for protocol in ["7", "12"] {
        let Some(mut client) = peers::python("crtp_client.py") else { return };
        let testbed = Testbed::new(&format!("cflib-{protocol}"));
        let address = format!("127.0.0.1:{}", free_port());
        let link = format!("crtp:udp:{address}");
        let version = format!("plant.wire.crtp.protocol={protocol}");
        let preset = "vehicle.preset=crazyflie-2.1";
        let words = ["plant-sim", "run", "--wire", &link, "--set", preset, "--set", &version];
        let vehicle = testbed.start(&words);
        wait_for("the vehicle", || UdpSocket::bind(&address).is_err().then_some(()));
        let output = client.args([address.as_str(), protocol]).output().unwrap();
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}\n{printed}", stderr(&output));
        vehicle.signal(Signal::TERM);
        vehicle.wait();
    }
}
