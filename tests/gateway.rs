//! `oqtal gateway run` as a process: references of a program move the vehicle, from this machine and over the network.

use std::fs::{File, Permissions};
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::process::{Command, Stdio};
use std::time::Duration;

use oqtal_bus::code::Mode;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

use crate::common::network::free_port;
use crate::common::{Running, Testbed, json, skipped, state_of, stderr, wait_for};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/stream_references.py");

/// A gateway that serves.
fn gateway(testbed: &Testbed, words: &[&str]) -> Running {
    let told = testbed.path("gateway.txt");
    let mut command = testbed.oqtal(&[&["gateway", "run"], words].concat());
    let process = Running::start_with_stderr(&mut command, File::create(&told).unwrap().into());
    wait_for("the gateway", || {
        std::fs::read_to_string(&told).unwrap().contains("gateway at").then_some(())
    });
    process
}

/// The script flies half a circle, after which the vehicle rests and lands since the references end.
fn flies_half_a_circle(testbed: &Testbed, gateway_words: &[&str], script_words: &[&str]) {
    if Command::new("python3").arg("--version").output().is_err() {
        skipped("there is no python3");
        return;
    }
    let flight = testbed.start(&["fly", "--json", "--trajectory", "hover", "--duration", "600"]);
    testbed.wait_for_daemon();
    let mut telemetry = testbed.bus().observer(&TELEMETRY).unwrap();
    let mut last = None;
    let mut tick = move || {
        last = telemetry.latest().unwrap().map(|(_, tick)| tick).or(last);
        last
    };
    wait_for("the hover", || {
        tick()
            .is_some_and(|tick| tick.mode == Mode::Flying.code() && tick.position[2] > 0.9)
            .then_some(())
    });
    let _gateway = gateway(testbed, gateway_words);
    let mut command = Command::new("python3");
    command.arg(SCRIPT).args(script_words).args(["--seconds", "5"]);
    let script = Running::start(&mut command);
    wait_for("the far side of the circle", || tick()?.position[0].lt(&-0.8).then_some(()));
    let flown = testbed.oqtal(&["ctl", "get"]).output().unwrap().stdout;
    assert!(String::from_utf8_lossy(&flown).contains(", references of a planner"));
    let output = script.wait();
    assert!(output.status.success(), "{}", stderr(&output));
    let summary = json(&flight.wait());
    assert_eq!(summary["outcome"], "landed", "{summary:#}");
    let output = command.args(["--seconds", "1"]).output().unwrap();
    assert!(
        !output.status.success() && stderr(&output).contains("followed none"),
        "{}",
        stderr(&output)
    );
}

/// A request to a daemon that hangs is answered after seconds.
#[test]
fn a_stop_and_a_landing_wait_for_no_other_request() {
    let testbed = Testbed::new("gateway-stop");
    let processes = testbed.services();
    testbed.wait_for_daemon();
    let daemon = &processes[2];
    let _gateway = gateway(&testbed, &[]);
    let path = testbed.path("program.sock");
    let program = UnixDatagram::bind(&path).unwrap();
    program.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let ask = |request| {
        let text = format!("{{\"version\": 1, \"request\": \"{request}\", \"arguments\": []}}");
        program.send_to(text.as_bytes(), testbed.paths().directory().join("gateway.sock")).unwrap();
    };
    daemon.signal(Signal::STOP);
    ["status", "hover", "hover"].into_iter().for_each(ask);
    ask("land");
    ask("stop");
    let reply = || {
        let mut reply = [0; 4096];
        let length = program.recv(&mut reply).unwrap();
        String::from_utf8_lossy(&reply[..length]).into_owned()
    };
    let replies: Vec<String> = (0..5).map(|_| reply()).collect();
    daemon.signal(Signal::CONT);
    let place = |text: &str| replies.iter().position(|reply| reply.contains(text));
    // Absent if also the first `status` still waited.
    let unanswered = place("runs on instance").unwrap_or(replies.len());
    for text in ["land: requested by signal", "\"text\":\"stop"] {
        assert!(place(text).is_some_and(|place| place < unanswered), "{replies:#?}");
    }
    // An `arm` among them would end the stop.
    let refused = replies.iter().filter(|reply| reply.contains("requested after it")).count();
    assert!(refused >= 2, "{replies:#?}");
}

#[test]
fn an_arm_that_waited_in_a_suspended_gateway_begins_no_flight_after_a_stop() {
    let testbed = Testbed::new("gateway-suspended");
    let _processes = testbed.services();
    testbed.wait_for_daemon();
    let gateway = gateway(&testbed, &[]);
    let program = UnixDatagram::bind(testbed.path("program.sock")).unwrap();
    program.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let socket = testbed.paths().directory().join("gateway.sock");
    let ask = |words: &[&str], between: &dyn Fn()| {
        gateway.signal(Signal::STOP);
        wait_for("the suspension", || (state_of(gateway.id()) == Some('T')).then_some(()));
        for word in words {
            let text = format!("{{\"version\": 1, \"request\": \"{word}\"}}");
            program.send_to(text.as_bytes(), &socket).unwrap();
        }
        between();
        gateway.signal(Signal::CONT);
        let mut reply = [0; 4096];
        let length = program.recv(&mut reply).unwrap();
        String::from_utf8_lossy(&reply[..length]).into_owned()
    };
    let stop = || drop(testbed.oqtal(&["ctl", "stop"]).output().unwrap());
    let told = ask(&["arm"], &stop);
    assert!(told.contains("\"refused\"") && told.contains("called off by a later stop"), "{told}");
    let status = json(&testbed.oqtal(&["ctl", "status", "--json"]).output().unwrap());
    assert_eq!(status["mode"], "disarmed", "{status:#}");
    // A request that waited for a short time alone is executed.
    assert!(ask(&["status"], &|| ()).contains("\"done\""));
}

#[test]
fn an_unknown_request_is_answered_with_the_known_ones_and_the_last_process_removes_the_directory() {
    let testbed = Testbed::new("gateway-alone");
    let gateway = gateway(&testbed, &[]);
    let directory = testbed.paths().directory().to_owned();
    let program = UnixDatagram::bind(testbed.path("program.sock")).unwrap();
    program.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let text = r#"{"version": 1, "request": "statos"}"#;
    program.send_to(text.as_bytes(), directory.join("gateway.sock")).unwrap();
    let mut reply = [0; 4096];
    let length = program.recv(&mut reply).unwrap();
    let told = String::from_utf8_lossy(&reply[..length]);
    assert!(told.contains("unknown request `statos`; known: status, arm"), "{told}");
    gateway.signal(Signal::INT);
    assert!(gateway.wait().status.success());
    assert!(!directory.exists());
}

#[test]
fn the_examples_in_python_say_what_is_wrong() {
    if Command::new("python3").arg("--version").output().is_err() {
        skipped("there is no python3");
        return;
    }
    let testbed = Testbed::new("examples");
    let file = |name: &str, text: &str| testbed.write(name, text).display().to_string();
    let (own, short) = (file("own.key", &"0".repeat(64)), file("short.key", "01"));
    // Bound, so that nothing is refused; it replies to nobody, as a gateway with another key.
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap().to_string();
    let law = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/external_law/pd.py");
    for (words, told) in [
        (&[SCRIPT, "--udp", &address, "--key", &own][..], "the gateway has another key"),
        (&[SCRIPT, "--udp", &address, "--key", &short], "1 bytes; a key has 32"),
        (&[SCRIPT, "--udp", &address, "--key", "/nowhere.key"], "No such file"),
        (&[SCRIPT, "--udp", &address], "--udp needs --key"),
        (&[SCRIPT, "--udp", "localhost", "--key", &own], "expected HOST:PORT"),
        (&[SCRIPT, "--socket", "/nowhere.sock"], "start `oqtal gateway run`"),
        (&[law, "/nowhere/law"], "give the socket `law`"),
    ] {
        let output = Command::new("python3").args(words).output().unwrap();
        let message = stderr(&output);
        assert!(!output.status.success() && message.contains(told), "{words:?}: {message}");
        assert!(!message.contains("Traceback"), "{words:?}: {message}");
    }
}

/// Sends requests to a gateway that starts again, and is told that another sender's clock is ahead.
const RESTARTED: &str = r#"
import socket, sys, time
sys.path.insert(0, sys.argv[1])
from stream_references import Remote, read_key
gateway = Remote(sys.argv[2], read_key(sys.argv[3]))

def ask():
    while True:
        gateway.send({"version": 1, "request": "statos"})
        time.sleep(0.02)
        while reply := gateway.reply():
            if "unknown request" in reply["text"]:
                return

other = Remote(sys.argv[2], gateway.key)
other.offset_ns = 3 * 10**9
other.send({"version": 1, "request": "statos"})
ask()
print("asked", flush=True)
sys.stdin.readline()
ask()
# A reply that comes back to its gateway has no reply.
silent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
silent.settimeout(0.5)
text = b"gateway %s 5\n{}" % gateway.session.encode()
silent.sendto(gateway.code(text) + b" " + text, gateway.socket.getpeername())
try:
    sys.exit(silent.recv(4096))
except TimeoutError:
    pass
"#;

#[test]
fn a_program_on_the_network_continues_after_a_restart_and_with_its_clock_behind() {
    if Command::new("python3").arg("--version").output().is_err() {
        skipped("there is no python3");
        return;
    }
    let testbed = Testbed::new("gateway-restart");
    let key = testbed.write("gateway.key", &format!("{}\n", "0123456789abcdef".repeat(4)));
    std::fs::set_permissions(&key, Permissions::from_mode(0o600)).unwrap();
    let (key, address) = (key.display().to_string(), format!("127.0.0.1:{}", free_port()));
    let words = ["--udp", &address, "--key", &key];
    let first = gateway(&testbed, &words);
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/examples");
    let mut program = Command::new("python3")
        .args(["-B", "-c", RESTARTED, examples, &address, &key])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(program.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line, "asked\n");
    first.signal(Signal::INT);
    assert!(first.wait().status.success());
    let _second = gateway(&testbed, &words);
    drop(program.stdin.take());
    assert!(program.wait().unwrap().success());
}

#[test]
fn a_program_on_this_machine_flies_the_vehicle() {
    let testbed = Testbed::new("gateway-local");
    let socket = testbed.paths().directory().join("gateway.sock").display().to_string();
    flies_half_a_circle(&testbed, &[], &["--socket", &socket]);
}

#[test]
fn a_program_on_the_network_flies_the_vehicle_with_the_key() {
    let testbed = Testbed::new("gateway-udp");
    let key = testbed.write("gateway.key", &format!("{}\n", "0123456789abcdef".repeat(4)));
    let name = key.display().to_string();
    let address = format!("127.0.0.1:{}", free_port());
    let words = ["gateway", "run", "--udp", &address, "--key", &name];
    std::fs::set_permissions(&key, Permissions::from_mode(0o644)).unwrap();
    testbed.refuses(&words, 77, &["other users", "chmod 600"]);
    testbed.refuses(&words[..4], 64, &["--key"]);
    std::fs::set_permissions(&key, Permissions::from_mode(0o600)).unwrap();
    flies_half_a_circle(&testbed, &words[2..], &["--udp", &address, "--key", &name]);
}
