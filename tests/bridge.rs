//! The bridge as a process on a pseudo-terminal: frames, safety without the daemon, port.

mod chain;
mod flight;
mod ports;
mod vehicle;

use crate::common::{Running, signal, stderr, wait_for};
use flight::{BridgeFlight, PERIOD, TIME_OUT, airborne, is_zero, stick};
use oqtal_bus::bus::Bus;
use oqtal_bus::message::{CommandV1, PoseV1, Stamps};
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_wire::asctec::ControlInput;
use rustix::process::Signal;
use vehicle::{Manner, PtyVehicle};

#[test]
fn a_flight_leaves_nothing_in_shared_memory_in_any_order_of_drops() {
    let (flight, commander) = airborne("remains");
    let BridgeFlight { testbed, bus, reports, bridge, vehicle } = flight;
    bridge.signal(Signal::TERM);
    assert!(bridge.wait().status.success());
    drop((bus, commander));
    assert!(!testbed.remains().is_empty());
    drop(reports);
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    drop(vehicle);
}

#[test]
fn a_vehicle_that_answers_has_a_link_and_one_that_falls_silent_has_none() {
    let mut flight = BridgeFlight::new("silence", Manner::Answering);
    let answer = flight.until("an answer", |vehicle| vehicle.link == 1);
    assert!((answer.air_ns, answer.armed, answer.starting) == (17_000_000, 0, 0), "{answer:?}");
    let settled = flight.until("quality", |v| v.link_quality > 0.9 && v.battery_v > 0.0);
    assert!((settled.battery_v - 11.1).abs() < 1e-3);
    // 17 bytes of ten bits at 57600 baud; a frame may wait behind a poll.
    assert!((2_900_000..5_000_000).contains(&settled.wire_ns), "{settled:?}");
    flight.vehicle.set_manner(Manner::Silent);
    let silent = flight.until("silence", |vehicle| vehicle.link == 0);
    assert!(silent.link_quality < 0.1, "{silent:?}");
    let status = flight.testbed.oqtal(&["ctl", "status"]).output().unwrap();
    assert_eq!(status.status.code(), Some(75), "no daemon runs");
    flight.vehicle.set_manner(Manner::Answering);
    flight.until("an answer again", |vehicle| vehicle.link == 1);
}

#[test]
fn f20_noise_in_place_of_telemetry_is_never_an_answer_and_frames_continue() {
    let mut flight = BridgeFlight::new("noise", Manner::Noise);
    let setpoints = flight.setpoints(240);
    assert!(setpoints.iter().all(is_zero));
    for _ in 0..100 {
        let (_, vehicle) = flight.next();
        assert_eq!((vehicle.link, vehicle.armed), (0, 0), "{vehicle:?}");
    }
    flight.bridge.signal(Signal::TERM);
    assert!(flight.bridge.wait().status.success());
}

#[test]
fn motors_are_started_and_stopped_and_commands_flow_in_between() {
    let (mut flight, mut commander) = airborne("motors");
    let running = flight.until("motors", |vehicle| vehicle.armed == 1);
    assert_eq!(running.starting, 0);
    let wanted = commander.send(stick(0.2), Time::now());
    let (header, applied) = wait_for("a command applied", || {
        flight.reports.receive().unwrap().filter(|(_, v)| v.command_sequence >= wanted)
    });
    assert!(header.stamps.applied_at >= header.stamps.received_at);
    assert!(header.stamps.received_at >= header.stamps.command_published_at);
    assert!(applied.wire_ns >= 2_900_000);
    let vehicle = &flight.vehicle;
    vehicle.clear_log();
    commander.until("motors to stop", CommandV1::default(), || {
        (!vehicle.log().motors_run).then_some(())
    });
    let setpoints = vehicle.log().setpoints;
    let rest =
        setpoints.iter().skip_while(|setpoint| !is_zero(setpoint)).take_while(|o| is_zero(o));
    assert!(rest.count() > 60, "zero set-points for a while before the switch");
    assert_eq!(vehicle.log().emergency_stops, 0);
}

#[test]
fn f14_after_the_last_command_at_most_four_frames_are_not_zero() {
    let (flight, commander) = airborne("last-command");
    flight.vehicle.clear_log();
    drop(commander);
    let setpoints = wait_for("setpoints", || {
        let setpoints = flight.vehicle.log().setpoints;
        (setpoints.len() > 180).then_some(setpoints)
    });
    assert_few_then_zero(&setpoints);
}

fn assert_few_then_zero(setpoints: &[ControlInput]) {
    let others = setpoints.iter().filter(|setpoint| !is_zero(setpoint)).count();
    assert!(others <= 4, "{others} frames were not zero set-points");
    assert!(setpoints[4..].iter().all(is_zero));
}

#[test]
fn f15_a_stop_bypasses_a_daemon_that_continues_to_command_flight() {
    let (mut flight, mut commander) = airborne("stop");
    flight.vehicle.clear_log();
    let stop = flight.testbed.oqtal(&["ctl", "stop", "--json"]);
    let stop = Running::start(&mut { stop });
    let vehicle = &flight.vehicle;
    commander.until("motors to stop", stick(0.2), || (!vehicle.log().motors_run).then_some(()));
    commander.until("the operator's answer", stick(0.2), || (!stop.runs()).then_some(()));
    assert_eq!(stop.wait().status.code(), Some(0));
    flight.until("the stop", |vehicle| (vehicle.armed, vehicle.stopped) == (0, 1));
    let vehicle = &flight.vehicle;
    vehicle.clear_log();
    commander
        .until("set-points", stick(0.2), || (vehicle.log().setpoints.len() > 60).then_some(()));
    assert!(vehicle.log().setpoints.iter().all(is_zero));
    // An operator arms again: the daemon has commanded "disarmed" before.
    let zero = CommandV1::default();
    let reports = &mut flight.reports;
    commander.until("the end of the stop", zero, || {
        reports.latest().unwrap().filter(|(_, vehicle)| vehicle.stopped == 0)
    });
    commander.until("motors again", stick(0.2), || vehicle.log().motors_run.then_some(()));
    assert_eq!(vehicle.log().emergency_stops, 0);
}

#[test]
fn f18_a_stop_reaches_a_vehicle_whose_bridge_was_killed_in_flight() {
    for is_raised_first in [false, true] {
        let (flight, mut commander) = airborne("restart");
        let BridgeFlight { testbed, vehicle, bridge, .. } = flight;
        bridge.signal(Signal::KILL);
        bridge.wait();
        let zero = CommandV1::default();
        let stop = || StopSwitch::existing(&testbed.paths()).unwrap().unwrap().raise();
        if is_raised_first {
            stop();
        }
        vehicle.clear_log();
        let link = vehicle.link();
        let words = [&["bridge", "run", "--link", &link], &TIME_OUT[..]].concat();
        vehicle.release_port();
        let _bridge = testbed.start(&words);
        if !is_raised_first {
            let is_zero_for_long = || (vehicle.log().setpoints.len() > 200).then_some(());
            commander.until("zero set-points", zero, is_zero_for_long);
            assert!(vehicle.log().motors_run, "without a stop a pilot may fly");
            stop();
        }
        let has_stopped = || (!vehicle.log().motors_run).then_some(());
        commander.until("motors to stop", zero, has_stopped);
        assert_eq!(vehicle.log().emergency_stops, 0);
    }
}

#[test]
fn a_command_that_is_old_when_it_arrives_is_never_sent() {
    let (flight, mut commander) = airborne("old");
    std::thread::sleep(4 * PERIOD);
    let setpoints = flight.setpoints(10);
    assert!(setpoints[4..].iter().all(is_zero));
    flight.vehicle.clear_log();
    for _ in 0..20 {
        commander.send(stick(0.9), Time::now() - Span::from_millis(51));
        commander.send(stick(0.9), Time::now() + Span::from_millis(500));
        std::thread::sleep(PERIOD);
    }
    assert!(flight.vehicle.log().setpoints.iter().all(is_zero));
}

/// Publishes poses of a vehicle on the floor, like a motion capture system, until `stop`.
fn publish_poses(bus: &Bus, stop: &std::sync::atomic::AtomicBool) {
    let mut poses = bus.writer(&POSE).unwrap();
    let mut frame = 0;
    while !stop.load(std::sync::atomic::Ordering::Acquire) {
        frame += 1;
        let now = Time::now();
        let position = [1e-6 * (frame % 7) as f64, 0.0, 0.0];
        let pose =
            PoseV1 { position, attitude: [0.0, 0.0, 0.0, 1.0], tracked: 1, ..PoseV1::default() };
        let stamps = Stamps { captured_at: now, pose_published_at: now, ..Stamps::default() };
        poses.send(frame, stamps, pose).unwrap();
        poses.notify().unwrap();
        std::thread::sleep(PERIOD);
    }
}

/// Sends a signal to a daemon in flight; the bridge must send zero set-points without it.
fn daemon_falls(name: &str, sent: Signal) {
    let mut flight = BridgeFlight::new(name, Manner::Answering);
    flight.until("an answer", |vehicle| vehicle.link == 1);
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|threads| {
        let testbed = &flight.testbed;
        threads.spawn(|| publish_poses(&testbed.bus(), &stop));
        let daemon = testbed.start(&[&["daemon", "run"], &TIME_OUT[..]].concat());
        wait_for("the daemon to arm", || {
            testbed.oqtal(&["ctl", "arm"]).output().unwrap().status.success().then_some(())
        });
        wait_for("thrust on the wire", || {
            flight.vehicle.log().setpoints.last().filter(|setpoint| setpoint.thrust > 0).map(drop)
        });
        signal(daemon.id(), sent);
        flight.vehicle.clear_log();
        let setpoints = wait_for("setpoints", || {
            let setpoints = flight.vehicle.log().setpoints;
            (setpoints.len() > 150).then_some(setpoints)
        });
        stop.store(true, std::sync::atomic::Ordering::Release);
        assert_few_then_zero(&setpoints);
    });
}

#[test]
fn f14_after_a_killed_daemon_the_set_point_is_zero() {
    daemon_falls("killed", Signal::KILL);
}

#[test]
fn f15_after_a_stopped_daemon_the_set_point_is_zero() {
    daemon_falls("stopped", Signal::STOP);
}

#[test]
fn f19_a_port_that_comes_back_is_found_and_begins_with_a_zero_set_point() {
    let (mut flight, mut commander) = airborne("unplugged");
    let port = flight.testbed.path("port");
    let log = std::mem::replace(
        &mut flight.vehicle,
        PtyVehicle::new(&flight.testbed.path("spare"), Manner::Answering),
    )
    .unplug();
    assert_eq!(log.damaged, 0);
    flight.until("the loss", |vehicle| vehicle.link == 0);
    flight.vehicle = PtyVehicle::new(&port, Manner::Answering);
    let vehicle = &flight.vehicle;
    // The flight request did not end, so set-points are zero until it does.
    let setpoints = commander.until("frames after the loss", stick(0.5), || {
        let setpoints = vehicle.log().setpoints;
        (setpoints.len() > 90).then_some(setpoints)
    });
    assert!(setpoints.iter().all(is_zero));
    let mut count = 0;
    commander.until("calm", CommandV1::default(), || {
        count += 1;
        (count > 10).then_some(())
    });
    commander.until("motors", stick(0.1), || vehicle.log().motors_run.then_some(()));
}

#[test]
fn f33_asked_to_end_the_bridge_sends_zero_set_points_and_stops_motors_that_run() {
    let (flight, mut commander) = airborne("term");
    let BridgeFlight { vehicle, bridge, .. } = flight;
    commander
        .until("some flight", stick(0.1), || (vehicle.log().setpoints.len() > 30).then_some(()));
    commander.send(stick(0.1), Time::now());
    bridge.signal(Signal::TERM);
    let output = bridge.wait();
    assert!(output.status.success(), "{}", stderr(&output));
    let log = wait_for("the emergency stop", || {
        Some(vehicle.log()).filter(|log| log.emergency_stops > 0)
    });
    let last = log.setpoints.iter().rev().take_while(|setpoint| is_zero(setpoint)).count();
    assert!((3..=4).contains(&last), "{last} zero set-points at last");
    assert!(!log.motors_run);
}
