//! Ports that cannot be opened, and independent readers of the bridge's frames.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};

use super::flight::{BridgeFlight, airborne, is_zero, stick};
use super::vehicle::{Manner, PtyVehicle};
use crate::common::{Testbed, assert_refused, peers, skipped, stderr};
use oqtal_wire::asctec::ControlInput;

/// Starts the independent reader with the arguments `words`, using the interpreter `OQTAL_PEERS_PYTHON`, which must then exist,
/// or `python3`.
fn independent_reader(words: &[&str]) -> Option<Child> {
    let script = peers::script_path("asctec_reader.py");
    let named = std::env::var_os("OQTAL_PEERS_PYTHON");
    let mut reader = Command::new(named.as_deref().unwrap_or("python3".as_ref()));
    reader.arg(script).args(words).stdin(Stdio::piped()).stdout(Stdio::piped());
    match reader.spawn() {
        Ok(reader) => Some(reader),
        Err(error) => {
            assert!(named.is_none(), "OQTAL_PEERS_PYTHON names no interpreter: {error}");
            skipped("there is no python3 to read the frames with");
            None
        }
    }
}

#[test]
fn an_independent_reader_sees_the_commands_of_a_flight_and_nothing_invalid() {
    let Some(mut reader) = independent_reader(&["-"]) else { return };
    let (flight, mut commander) = airborne("flown-reader");
    let vehicle = &flight.vehicle;
    let mut count = 0;
    for deflection in [0.3, -0.7, 1.0] {
        count += 40;
        commander.until("flight", stick(deflection), || {
            (vehicle.log().setpoints.iter().filter(|setpoint| setpoint.thrust > 0).count() > count)
                .then_some(())
        });
    }
    let log = flight.vehicle.log();
    assert_eq!((log.damaged, log.skipped), (0, 0));
    reader.stdin.take().unwrap().write_all(&log.bytes).unwrap();
    let output = reader.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let fields = |setpoint: &ControlInput| {
        serde_json::json!([
            setpoint.pitch,
            setpoint.roll,
            setpoint.yaw,
            setpoint.thrust,
            setpoint.enabled
        ])
    };
    let setpoints: Vec<_> = log.setpoints.iter().map(fields).collect();
    assert_eq!(seen["fields"], serde_json::Value::from(setpoints));
    assert_eq!((&seen["invalid"], &seen["strange_bytes"]), (&0.into(), &0.into()));
    assert_eq!((&seen["polls"], &seen["stops"]), (&log.polls.into(), &0.into()));
}

#[test]
fn an_independent_reader_sees_valid_zero_set_points_at_sixty_hertz_without_a_daemon_or_an_answer() {
    let testbed = Testbed::new("reader");
    let link = testbed.path("port");
    let Some(mut reader) = independent_reader(&[link.to_str().unwrap(), "300"]) else { return };
    let mut lines = BufReader::new(reader.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "ready");
    let _bridge =
        testbed.start(&["bridge", "run", "--link", &format!("asctec:{}", link.display())]);
    let seen: serde_json::Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    assert!(reader.wait().unwrap().success());
    assert_eq!(seen["invalid"], 0, "{seen}");
    assert_eq!(seen["strange_bytes"], 0, "{seen}");
    assert_eq!(seen["zero_setpoints"], 300, "{seen}");
    assert_eq!(seen["stops"], 0, "{seen}");
    // 8 polls per second on 60 frames: 40 in 300 frames.
    assert!((35..=45).contains(&seen["polls"].as_u64().unwrap()), "{seen}");
    let gap = seen["median_gap_ms"].as_f64().unwrap();
    assert!((gap - 16.667).abs() < 1.0, "{seen}");
}

/// Checks that the bridge, started with `words`, ends with exit code `code` and a message that contains `parts`.
#[track_caller]
fn refused(testbed: &Testbed, words: &[&str], code: i32, parts: &[&str]) {
    testbed.refuses(&[&["bridge"], words].concat(), code, parts);
}

#[test]
fn a_port_that_does_not_exist_is_named_with_a_remedy() {
    let testbed = Testbed::new("ports");
    let file = testbed.write("file", "no port");
    refused(&testbed, &["run"], 78, &["bridge.link", "--link"]);
    refused(&testbed, &["run", "--link", "asctec:/dev/nowhere"], 71, &["/dev/nowhere", "plug"]);
    let link = format!("asctec:{}", file.display());
    refused(&testbed, &["run", "--link", &link], 71, &["not a serial port", "--link"]);
    refused(&testbed, &["run", "--link", "asctec:/"], 71, &["not a serial port"]);
    refused(&testbed, &["check", "--link", "boat:/dev/ttyS0"], 78, &["boat"]);
    let slow = ["check", "--link", "asctec:/dev/ttyS0,baud=9600"];
    refused(&testbed, &slow, 78, &["bridge.link", "9600"]);
    let virtual_time = ["check", "--link", "asctec:/dev/ttyS0", "--set", "clock.kind=lockstep"];
    refused(&testbed, &virtual_time, 64, &["clock"]);
    let bad = testbed.write("bad.toml", "[bridge]\n\nlink = \"boat:/dev/ttyS0\"\n");
    refused(&testbed, &["check", "--config", bad.to_str().unwrap()], 78, &["bad.toml:3: ", "boat"]);
}

#[test]
fn a_port_without_permission_is_reported() {
    let testbed = Testbed::new("nobody");
    let vehicle = PtyVehicle::new(&testbed.path("port"), Manner::Answering);
    let device = testbed.path("port").canonicalize().unwrap();
    std::fs::set_permissions(&device, std::os::unix::fs::PermissionsExt::from_mode(0o000)).unwrap();
    let mut command =
        testbed.oqtal(&["bridge", "run", "--link", &format!("asctec:{}", device.display())]);
    if rustix::process::geteuid().is_root() {
        // Root may open everything, so the bridge runs as another user, with a separate root directory.
        use std::os::unix::process::CommandExt;
        let root = tempfile::tempdir().unwrap();
        std::os::unix::fs::chown(root.path(), Some(65534), Some(65534)).unwrap();
        command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(["bridge", "run", "--link", &format!("asctec:{}", device.display())]);
        command.args(["--instance", testbed.instance(), "--root"]).arg(root.path());
        command.current_dir("/").uid(65534).gid(65534);
        assert_refused(&command.output().unwrap(), 77, &["no permission for /dev/pts/"]);
    } else {
        assert_refused(&command.output().unwrap(), 77, &[]);
    }
    drop(vehicle);
}

#[test]
fn f25_a_second_bridge_is_refused_and_the_first_continues() {
    let flight = BridgeFlight::new("second-bridge", Manner::Answering);
    let link = flight.vehicle.link();
    refused(&flight.testbed, &["run", "--link", &link], 75, &["vehicle", "is held by"]);
    // Another instance shares only the port with the first.
    let other = Testbed::new("other-bridge");
    refused(&other, &["run", "--link", &link], 75, &["used by another process"]);
    assert!(flight.setpoints(10).iter().all(is_zero));
}
