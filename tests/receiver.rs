//! The receiver as a process, with emulated camera systems on the loopback network.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::time::Instant;

use crate::common::network::{Server, free_port};
use crate::common::{Running, Testbed, json, number, stderr, wait_for};
use oqtal_bus::bus::Bus;
use oqtal_bus::message::{Header, PoseV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_wire::ByteOrder;
use oqtal_wire::qtm::QtmWriter;
use serde_json::Value;

/// Waits for the next pose.
fn next_pose(what: &str, poses: &mut Reader<PoseV1>) -> (Header, PoseV1) {
    wait_for(what, || poses.receive().unwrap())
}

fn drain(poses: &mut Reader<PoseV1>) {
    while poses.receive().unwrap().is_some() {}
}

#[test]
fn f54_a_server_that_restarts_and_a_renamed_body_need_no_restart_of_the_receiver() {
    let testbed = Testbed::new("server-restart");
    let bus = testbed.bus();
    let mut poses = bus.observer(&POSE).unwrap();
    for kind in ["qtm", "vrpn", "natnet"] {
        let server = Server::start(kind, free_port(), &["--body", "quad"]);
        let port = server.port;
        let link = server.link(",body=quad");
        let log = testbed.path(&format!("{kind}.log"));
        let written = std::fs::File::create(&log).unwrap();
        let mut command = testbed.oqtal(&["receiver", "run", "--link", &link]);
        let receiver = Running::start_with_stderr(&mut command, written.into());
        let (header, _) = next_pose("poses", &mut poses);
        let stamps = header.stamps;
        assert!(stamps.captured_at < stamps.pose_received_at);
        assert!(stamps.pose_received_at <= stamps.pose_published_at);
        drop(server);
        // A body with another name is ignored.
        let renamed = Server::start(kind, port, &["--body", "other"]);
        wait_for("the message of a missing body", || {
            let text = std::fs::read_to_string(&log).unwrap();
            text.contains("no body `quad` any more").then_some(())
        });
        let shows = |trouble: &str| {
            let status = testbed.oqtal(&["ctl", "status"]).output().unwrap();
            stderr(&status).contains(trouble).then_some(())
        };
        wait_for("a missing body in the status", || shows("the server has no such body"));
        drain(&mut poses);
        let silent_from = Time::now();
        drop(renamed);
        wait_for("silent cameras in the status", || shows("cameras silent"));
        let _server = Server::start(kind, port, &["--body", "quad"]);
        let (header, pose) = next_pose("poses of the restarted server", &mut poses);
        let Header { pose_sequence, stamps, .. } = header;
        assert!(pose.tracked == 1 && pose_sequence > 1);
        assert!(stamps.captured_at > silent_from && stamps.captured_at <= stamps.pose_received_at);
        drop(receiver);
        drain(&mut poses);
    }
}

#[test]
fn f55_impossible_links_are_refused_with_a_remedy() {
    let testbed = Testbed::new("receiver-use");
    let server = Server::start("qtm", free_port(), &["--body", "quad", "--body", "six"]);
    let vrpn = Server::start("vrpn", free_port(), &["--body", "quad"]);
    let nothing = free_port();
    let cases = [
        (server.link(",body=quat"), 71, "there are `quad`, `six`"),
        (server.link(""), 78, "a link with a body"),
        (format!("qtm:127.0.0.1:{},body=quad", vrpn.port), 78, "does not use qtm"),
        (format!("qtm:127.0.0.1:{nothing},body=quad"), 71, "no qtm server at 127.0.0.1"),
        (format!("natnet:127.0.0.1:{nothing},body=quad"), 71, "no natnet server"),
        ("qtm:no-such-host.invalid,body=quad".to_owned(), 71, "no address for the host"),
        ("vicon:127.0.0.1,body=quad".to_owned(), 78, "unknown kind `vicon`"),
    ];
    for (link, code, message) in cases {
        testbed.refuses(&["receiver", "run", "--link", &link], code, &[message]);
    }
    let link = server.link(",body=quad");
    let bus = testbed.bus();
    let mut poses = bus.observer(&POSE).unwrap();
    let _first = testbed.start(&["receiver", "run", "--link", &link]);
    next_pose("poses", &mut poses);
    testbed.refuses(&["receiver", "run", "--link", &link], 75, &[]);
    next_pose("poses of the first receiver", &mut poses);
}

/// Server that greets like QTM and refuses every version.
fn serve_an_unknown_version(listener: &TcpListener) {
    let (mut stream, mut text) = (listener.accept().unwrap().0, Vec::new());
    QtmWriter::new(&mut text, ByteOrder::Little).command("QTM RT Interface connected");
    let mut refusal = Vec::new();
    QtmWriter::new(&mut refusal, ByteOrder::Little).error("Version NOT supported");
    // Until the receiver disconnects.
    while stream.write_all(&text).is_ok() && stream.read(&mut [0; 1000]).is_ok_and(|n| n > 0) {
        text.clone_from(&refusal);
    }
}

#[test]
fn f55_missing_versions_ports_and_permissions_are_reported() {
    let testbed = Testbed::new("receiver-refused");
    let unknown = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let silent = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = |listener: &TcpListener| listener.local_addr().unwrap().port();
    let (old, mute) = (port(&unknown), port(&silent));
    let refusing = std::thread::spawn(move || serve_an_unknown_version(&unknown));
    let natnet = Server::start("natnet", free_port(), &["--body", "quad"]);
    let _taken = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, natnet.port + 1)).unwrap();
    let cases = [
        (format!("qtm:127.0.0.1:{old},body=quad"), 76, "no version of the RT protocol from"),
        (format!("qtm:127.0.0.1:{mute},body=quad"), 71, "it sends nothing"),
        (natnet.link(",body=quad"), 75, "is used by another process"),
        ("natnet:255.255.255.255,body=quad".to_owned(), 77, "no permission for 255.255.255.255"),
    ];
    for (link, code, message) in cases {
        testbed.refuses(&["receiver", "run", "--link", &link], code, &[message]);
    }
    refusing.join().unwrap();
}

#[test]
fn a_probe_examines_every_protocol_and_discovery_lists_the_bodies() {
    let testbed = Testbed::new("probe");
    for (kind, rest) in [
        ("qtm", ""),
        ("qtm", ",transport=tcp"),
        ("vrpn", ""),
        ("natnet", ""),
        ("natnet", ",unicast"),
    ] {
        let server = Server::start(kind, free_port(), &["--body", "quad", "--body", "six"]);
        let link = server.link(rest);
        let probe = ["receiver", "probe", &link, "--seconds", "1", "--json"];
        let output = testbed.oqtal(&probe).output().unwrap();
        let figures = json(&output);
        let rate = number(&figures, "/rate_hz");
        assert!((50.0..150.0).contains(&rate), "{kind}{rest}: {figures}");
        assert_eq!(figures.pointer("/bodies/1/name").and_then(Value::as_str), Some("six"));
        assert_eq!(number(&figures, "/bodies/0/tracked"), 1.0, "{figures}");
        let keys =
            ["/interval/p99_ns", "/clock/residual_p99_ns", "/gaps", "/camera_rate_hz", "/loss"];
        for key in keys {
            number(&figures, key);
        }
        // Frames of VRPN have no numbers.
        assert_eq!(figures["lost"].is_u64(), kind != "vrpn", "{figures}");
        let verdict = figures["verdict"].as_str().unwrap();
        assert!(["fit", "limited", "unfit"].contains(&verdict), "{figures}");
        assert!(number(&figures, "/clock/offset_ns").abs() < 1e9, "one clock: {figures}");
    }
}

#[test]
fn one_receiver_serves_many_bodies_to_as_many_instances() {
    // A study takes longer and prints the processor time: RECEIVER_STUDY_SECONDS=60.
    let study = std::env::var("RECEIVER_STUDY_SECONDS").ok().and_then(|text| text.parse().ok());
    let (bodies, seconds) = if study.is_some() { (32, study.unwrap_or(0)) } else { (4, 2) };
    let testbed = Testbed::new("many");
    let names: Vec<String> = (0..bodies).map(|k| format!("body{k}")).collect();
    let mut words = vec!["--rate", "200"];
    words.extend(names.iter().flat_map(|name| ["--body", name]));
    let server = Server::start("qtm", free_port(), &words);
    let instance = |k: usize| format!("many-{}-{k}", std::process::id());
    let routes: String =
        names.iter().enumerate().map(|(k, name)| format!(",body={name}@{}", instance(k))).collect();
    let buses: Vec<Bus> = (0..bodies).map(|k| testbed.bus_of(&instance(k))).collect();
    let mut readers: Vec<_> = buses.iter().map(|bus| bus.observer(&POSE).unwrap()).collect();
    let receiver = testbed.start(&["receiver", "run", "--link", &server.link(&routes)]);
    readers.iter_mut().for_each(|reader| {
        next_pose("poses of every body", reader);
    });
    let began = (Instant::now(), cpu_ticks(&receiver));
    let mut received = vec![(0_u64, 0_u64, 0_u64); bodies];
    let end = Time::now() + Span::from_millis(seconds * 1000);
    while Time::now() < end {
        for (reader, (count, last, gaps)) in readers.iter_mut().zip(&mut received) {
            while let Some((header, pose)) = reader.receive().unwrap() {
                assert_eq!(pose.tracked, 1);
                *gaps += if *last > 0 { header.pose_sequence - *last - 1 } else { 0 };
                (*count, *last) = (*count + 1, header.pose_sequence);
            }
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let cpu = (cpu_ticks(&receiver) - began.1) as f64 / began.0.elapsed().as_secs_f64();
    let least = received.iter().map(|(count, ..)| *count).min().unwrap_or(0);
    let gaps: u64 = received.iter().map(|(.., gaps)| *gaps).sum();
    println!(
        "{bodies} bodies, {seconds} s: {least} poses of each at least, {gaps} frames without one, CPU {cpu:.1} %"
    );
    // A loaded machine may deliver two frames at once; only the newest is published.
    let sound = |gaps: u64| study.is_none() || gaps == 0;
    assert!(received.iter().all(|(count, _, gaps)| *count > 0 && sound(*gaps)), "{received:?}");
}

/// Processor time of a process \[ticks of 10 ms\].
fn cpu_ticks(process: &Running) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.id())).unwrap();
    let after = stat.rsplit(')').next().unwrap();
    let fields: Vec<u64> =
        after.split_whitespace().skip(11).take(2).map(|t| t.parse().unwrap()).collect();
    fields.iter().sum()
}

#[test]
fn a_flight_whose_poses_come_over_the_network_lands() {
    let testbed = Testbed::new("fly-qtm");
    let flight = ["--mocap", "qtm", "--trajectory", "hover", "--duration", "2"];
    let summary = testbed.lands(&flight);
    for hop in ["capture_to_receive", "receive_to_publish"] {
        assert!(number(&summary, &format!("/hops/{hop}/count")) > 100.0, "{summary}");
    }
    let received = number(&summary, "/hops/capture_to_receive/p50_ns");
    assert!((received / 15e6 - 1.0).abs() < 0.2, "the latency of the emulated cameras: {received}");
}

#[test]
fn real_cameras_with_a_simulated_vehicle_are_refused() {
    let testbed = Testbed::new("fly-link");
    let words = ["fly", "--mocap", "link:qtm:127.0.0.1,body=quad"];
    testbed.refuses(&words, 64, &["--vehicle link:LINK"]);
}
