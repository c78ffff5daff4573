//! Camera clients by other authors, connected to `serve`: each names the body and receives every frame, and the poses agree.
//!
//! The clients in Python need an interpreter with `tests/peers/requirements.txt` installed, named by `OQTAL_PEERS_PYTHON`; the one in
//! JavaScript a folder with the packages of `tests/peers/package.json`, named by `OQTAL_PEERS_NODE`. `.ci/run` installs both. Without
//! the variable a test is skipped with a message. `OQTAL_PEERS_SECONDS` is the time for which frames are received, 2 by default.

use std::ffi::OsString;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use serde::Deserialize;

use crate::served::Served;
use crate::turns::{self, SeenFrame};

const BODY: &str = "cf1";
const OTHER_BODY: &str = "quad & two";

#[derive(Deserialize)]
struct Output {
    bodies: Vec<String>,
    frames: Vec<(Option<u64>, [f64; 3], [f64; 9])>,
}

/// Number of frames to be received.
fn frames() -> usize {
    let seconds = std::env::var("OQTAL_PEERS_SECONDS").ok().and_then(|text| text.parse().ok());
    (seconds.unwrap_or(2.0) * turns::RATE_HZ) as usize
}

/// Server of the recording with two bodies.
fn serve(arguments: &[&str]) -> (Served, tempfile::NamedTempFile) {
    let recording = turns::recording();
    let file = recording.path().to_str().unwrap();
    let bodies = ["--replay", file, "--body", BODY, "--body", OTHER_BODY];
    (Served::start(&[arguments, &bodies].concat()), recording)
}

/// Value of an environment variable; prints that `peer` is skipped if it is not set.
fn variable(name: &str, peer: &str) -> Option<OsString> {
    let value = std::env::var_os(name);
    if value.is_none() {
        // Written directly to standard error: the output of a passing test is not shown.
        let reason = format!("{peer}: skipped, {name} is not set; .ci/run installs the peer\n");
        std::io::stderr().write_all(reason.as_bytes()).unwrap();
    }
    value
}

fn script(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/peers").join(name)
}

/// Frames received by a client; the client must succeed.
fn seen(command: &mut Command) -> Vec<SeenFrame> {
    let output = command.stdin(Stdio::null()).output();
    let output = output.unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {errors}");
    // Libraries also print on standard output; the JSON document is the last line.
    let text = String::from_utf8(output.stdout).unwrap();
    let printed: Output = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let bodies: Vec<&str> = printed.bodies.iter().map(String::as_str).collect();
    assert_eq!(bodies, [BODY, OTHER_BODY]);
    let frame = |(number, position, axes)| SeenFrame { number, position, axes };
    printed.frames.into_iter().map(frame).collect()
}

/// Frames received by a client in Python; `None` without an interpreter.
fn python(client: &str, port: u16) -> Option<Vec<SeenFrame>> {
    let python = variable("OQTAL_PEERS_PYTHON", client)?;
    let mut command = Command::new(python);
    command.arg(script("camera_clients.py")).args([client, &port.to_string(), BODY]);
    Some(seen(command.arg(frames().to_string())))
}

/// Checks that a client in Python receives every frame.
fn receives_every_frame(client: &str, port: u16) {
    if let Some(seen) = python(client, port) {
        assert_eq!(turns::check(&seen), 0, "{client}: frames are missing");
    }
}

/// Checks the poses of a client that keeps only the newest frame and may miss frames between polls.
fn receives_the_newest(client: &str, port: u16) {
    if let Some(seen) = python(client, port) {
        let left_out = turns::check(&seen);
        println!("{client}: {} frames, {left_out} steps left out or repeated frames", seen.len());
    }
}

/// Locks a port that cannot be configured at the client, against other tests on this machine.
fn locked(port: u16) -> File {
    let path = std::env::temp_dir().join(format!("oqtal-test-port-{port}"));
    // A file of another user can be locked, but not written.
    let file = File::open(&path).or_else(|_| File::create(&path)).unwrap();
    file.lock().unwrap();
    file
}

#[test]
fn qualisys_python_sdk() {
    let (server, _recording) = serve(&["--protocol", "qtm:0"]);
    receives_every_frame("qtm-rt", server.port("qtm", "little endian"));
}

#[test]
fn qualisys_cpp_sdk_in_libmotioncapture() {
    // The client receives at this port.
    let _port = locked(6734);
    let (server, _recording) = serve(&["--protocol", "qtm:0"]);
    receives_every_frame("qualisys", server.port("qtm", "little endian"));
}

#[test]
fn qualisys_javascript_sdk() {
    let Some(folder) = variable("OQTAL_PEERS_NODE", "qualisys-rt") else { return };
    let (server, _recording) = serve(&["--protocol", "qtm:0"]);
    let mut command = Command::new("node");
    command.env("NODE_PATH", PathBuf::from(folder).join("node_modules"));
    command.arg(script("camera_client.js")).arg(server.port("qtm", "little endian").to_string());
    let seen = seen(command.arg(BODY).arg(frames().to_string()));
    assert_eq!(turns::check(&seen), 0, "frames are missing");
}

#[test]
fn qualisys_crate_in_both_byte_orders_over_tcp_and_udp() {
    use qualisys::{ComponentOptions, ComponentType, Packet, Parameter, Protocol, StreamRate};
    let (server, _recording) = serve(&["--protocol", "qtm:0"]);
    for (what, distance, udp) in [("little endian", 1, true), ("big endian", 2, false)] {
        let builder = Protocol::builder();
        let builder = if distance == 2 { builder.big_endian() } else { builder };
        let mut client = builder.connect("127.0.0.1", server.port("qtm", what) - distance).unwrap();
        assert_eq!(client.version(), (1, 28));
        let parameters = client.get_parameters(&[Parameter::SixD]).unwrap();
        assert!(parameters.contains("<Name>quad &amp; two</Name>"), "{parameters}");
        let (kind, options) = ([ComponentType::Bodies6dResidual], ComponentOptions::default());
        if udp {
            let port = client.enable_udp_stream(0).unwrap();
            client.stream_frames_udp(StreamRate::AllFrames, &kind, &options, port, None).unwrap();
        } else {
            client.stream_frames(StreamRate::AllFrames, &kind, &options).unwrap();
        }
        let mut seen = Vec::new();
        while seen.len() < frames() {
            let packet = if udp { client.receive_udp() } else { client.receive() }.unwrap();
            let Packet::Data(frame) = packet else { continue };
            let body = &frame.bodies_6d_residual().unwrap().bodies[0];
            let position = [body.position.x, body.position.y, body.position.z];
            seen.push(SeenFrame {
                number: Some(u64::from(frame.frame_number)),
                position: position.map(|x| f64::from(x) * 1e-3),
                axes: body.rotation.map(f64::from),
            });
        }
        assert_eq!(turns::check(&seen), 0, "{what}: frames are missing");
    }
}

#[test]
fn vrpn_client_in_libmotioncapture() {
    let (server, _recording) = serve(&["--protocol", "vrpn:0"]);
    receives_the_newest("vrpn", server.port("vrpn", "direct"));
    receives_the_newest("vrpn-callback", server.port("vrpn", "direct"));
}

#[test]
fn optitrack_client_in_libmotioncapture() {
    // The client sends to this port.
    let _port = locked(1510);
    for version in ["3.1", "4.1"] {
        let (_server, _recording) = serve(&["--protocol", "natnet", "--natnet-version", version]);
        receives_the_newest("optitrack", 1510);
    }
}

#[test]
fn natnet_package_by_multicast_and_unicast() {
    for version in ["3.1", "4.1"] {
        let (server, _recording) = serve(&["--protocol", "natnet:0", "--natnet-version", version]);
        receives_every_frame("natnet", server.port("natnet", "requests"));
        receives_every_frame("natnet-unicast", server.port("natnet", "requests"));
    }
}
