//! MAVLink against pymavlink, in both directions: it reads what is written here, with the masks, frames and signs that autopilots need, and
//! what it writes, as a vehicle and as a ground station, is read here.
//!
//! Needs an interpreter with `tests/peers/requirements.txt` installed, named by `OQTAL_PEERS_PYTHON`; `.ci/run` installs one.
//! Without the variable the test is skipped with a message.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AckResult, AttitudeTarget, AutopilotFirmware, CommandKind, MavlinkAddress, MavlinkContent,
    MavlinkDecoder, MavlinkEncoder, MavlinkHeartbeat, MavlinkPose, ParameterName, ParameterValue,
    SetpointKind, SigningKey, TextSeverity, Timesync, VehicleCommandLong,
};
use serde_json::{Value, json};

const PYTHON: &str = "OQTAL_PEERS_PYTHON";
const OWN: MavlinkAddress = MavlinkAddress { system: 245, component: MavlinkAddress::COMPUTER };
const VEHICLE: MavlinkAddress = MavlinkAddress { system: 7, component: MavlinkAddress::AUTOPILOT };

/// Output of the script for these packets; `None` without a peer.
fn peer(packets: &[String]) -> Option<Vec<Value>> {
    let Some(python) = std::env::var_os(PYTHON) else {
        let reason = format!("mavlink_messages.py: skipped, {PYTHON} names no interpreter\n");
        std::io::stderr().write_all(reason.as_bytes()).unwrap();
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/peers/mavlink_messages.py");
    let mut command = Command::new(python);
    command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(packets.join("\n").as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn command(kind: CommandKind) -> MavlinkContent {
    MavlinkContent::Command(VehicleCommandLong { target: VEHICLE, kind, confirmation: 0 })
}

fn setpoint(kind: SetpointKind) -> MavlinkContent {
    MavlinkContent::AttitudeTarget(AttitudeTarget {
        target: VEHICLE,
        time_ms: 5,
        kind,
        thrust: 0.5,
    })
}

/// A message, its name, and some of its fields as pymavlink must read them.
type Sample = (MavlinkContent, &'static str, Value);

fn ours() -> Vec<Sample> {
    [setpoints(), poses(), commands(), others()].concat()
}

fn setpoints() -> Vec<Sample> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let attitude = |attitude| setpoint(SetpointKind::Attitude { attitude, yaw_rate: 0.25 });
    let sample = |content, fields| (content, "SET_ATTITUDE_TARGET", fields);
    let rates = json!({
        "type_mask": 128, "body_roll_rate": 0.125, "body_pitch_rate": -0.25, "body_yaw_rate": -0.5,
        "thrust": 0.5, "target_system": 7, "q": [1.0, 0.0, 0.0, 0.0],
    });
    // A turn to the left, nose down, left side up: yaw and pitch negative, roll positive.
    let left = json!({ "type_mask": 3, "q": [half, 0.0, 0.0, -half], "body_yaw_rate": -0.25 });
    vec![
        sample(setpoint(SetpointKind::Rates([0.125, 0.25, 0.5])), rates),
        sample(attitude([0.0, 0.0, half, half]), left),
        sample(attitude([0.0, half, 0.0, half]), json!({ "q": [half, 0.0, -half, 0.0] })),
        sample(attitude([half, 0.0, 0.0, half]), json!({ "q": [half, half, 0.0, 0.0] })),
    ]
}

fn poses() -> Vec<Sample> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let pose = MavlinkPose {
        time_us: 77,
        position: [1.0, 2.0, 3.0],
        attitude: [0.0, 0.0, half, half],
        position_sd_m: 0.5,
        attitude_sd_rad: 0.25,
    };
    let odometry = json!({
        "time_usec": 77, "frame_id": 20, "child_frame_id": 12, "estimator_type": 2,
        "x": 1.0, "y": -2.0, "z": -3.0, "q": [half, 0.0, 0.0, -half], "vx": null,
    });
    let vision = json!({
        "usec": 77, "x": 1.0, "y": -2.0, "z": -3.0, "roll": 0.0, "pitch": 0.0,
        "yaw": -std::f64::consts::FRAC_PI_2,
    });
    vec![
        (MavlinkContent::Odometry(pose), "ODOMETRY", odometry),
        (MavlinkContent::VisionPosition(pose), "VISION_POSITION_ESTIMATE", vision),
    ]
}

fn commands() -> Vec<Sample> {
    let sample = |kind, fields| (command(kind), "COMMAND_LONG", fields);
    vec![
        sample(
            CommandKind::SetMode { mode: 20, sub_mode: 0 },
            json!({ "command": 176, "param1": 1.0, "param2": 20.0, "target_system": 7 }),
        ),
        sample(
            CommandKind::Arm { run: false, is_forced: true },
            json!({ "command": 400, "param1": 0.0, "param2": 21196.0 }),
        ),
        sample(
            CommandKind::MessageInterval { message: 193, interval_us: 200_000 },
            json!({ "command": 511, "param1": 193.0, "param2": 200_000.0 }),
        ),
    ]
}

fn others() -> Vec<Sample> {
    use MavlinkContent as C;
    let heartbeat = MavlinkHeartbeat {
        autopilot: AutopilotFirmware::None,
        custom_mode: 0,
        is_armed: false,
        is_simulated: false,
    };
    let name = ParameterName::new("EK3_SRC1_POSXY").unwrap();
    let value = ParameterValue { raw: 6.0, is_real: false, code: 2 };
    let set = json!({ "param_id": "EK3_SRC1_POSXY", "param_value": 6.0, "param_type": 2 });
    let asked = json!({ "param_id": "EK3_SRC1_POSXY", "param_index": -1, "target_component": 1 });
    let sync = Timesync { answered: 9, asked: 8 };
    vec![
        (C::Heartbeat(heartbeat), "HEARTBEAT", json!({ "type": 18, "autopilot": 8 })),
        (C::GlobalOrigin { system: 7 }, "SET_GPS_GLOBAL_ORIGIN", json!({ "target_system": 7 })),
        (C::Timesync(sync), "TIMESYNC", json!({ "tc1": 9, "ts1": 8 })),
        (C::ParameterSet { target: VEHICLE, name, value }, "PARAM_SET", set),
        (C::ParameterRequest { target: VEHICLE, name }, "PARAM_REQUEST_READ", asked),
    ]
}

fn agrees(read: &Value, wanted: &Value) -> bool {
    match (read, wanted) {
        (Value::Number(read), Value::Number(wanted)) => {
            (read.as_f64().unwrap() - wanted.as_f64().unwrap()).abs() < 1e-6
        }
        (Value::Array(read), Value::Array(wanted)) => {
            read.len() == wanted.len() && read.iter().zip(wanted).all(|(a, b)| agrees(a, b))
        }
        (read, wanted) => read == wanted,
    }
}

/// Contents of the packets that pymavlink writes, in its order.
fn theirs() -> Vec<MavlinkContent> {
    use MavlinkContent as C;
    let heartbeat = |kind, custom_mode, is_armed| {
        let autopilot = AutopilotFirmware::Known(kind);
        C::Heartbeat(MavlinkHeartbeat { autopilot, custom_mode, is_armed, is_simulated: false })
    };
    let acknowledged =
        |command, result| C::Acknowledged { command, result, target: MavlinkAddress::ALL };
    let name = ParameterName::new("EK3_SRC1_POSXY").unwrap();
    let value = ParameterValue { raw: 6.0, is_real: false, code: 2 };
    vec![
        heartbeat(AutopilotKind::ArduPilot, 20, true),
        heartbeat(AutopilotKind::Px4, 0x60000, false),
        C::Battery(11.1),
        C::Timesync(Timesync { answered: 0, asked: 123_456_789 }),
        C::Timesync(Timesync { answered: 5, asked: 6 }),
        C::Estimator(383),
        C::Estimator(831),
        acknowledged(400, AckResult::Failed),
        acknowledged(176, AckResult::Accepted),
        C::Other,
        command(CommandKind::Arm { run: true, is_forced: false }),
        command(CommandKind::Arm { run: false, is_forced: true }),
        command(CommandKind::SetMode { mode: 6, sub_mode: 0 }),
        C::ParameterRequest { target: VEHICLE, name },
        C::ParameterSet { target: VEHICLE, name, value },
    ]
}

#[test]
fn pymavlink_reads_and_writes_the_same_messages() {
    let key = SigningKey::from_hex(&"0f".repeat(32)).unwrap();
    let mut signed = MavlinkEncoder::new(OWN);
    signed.sign(key, 1_800_000_000_000_000);
    let mut encoder = MavlinkEncoder::new(OWN);
    let ours = ours();
    let mut lines: Vec<String> =
        ours.iter().map(|(content, ..)| hex(encoder.encode(content).unwrap().as_bytes())).collect();
    let (first, ..) = &ours[0];
    lines.push(format!("signed {}", hex(signed.encode(first).unwrap().as_bytes())));
    let Some(printed) = peer(&lines) else { return };
    for ((_, name, wanted), read) in ours.iter().zip(&printed) {
        assert_eq!(read["name"], *name);
        assert_eq!(read["sender"], json!([245, 191]));
        for (field, value) in wanted.as_object().unwrap() {
            assert!(agrees(&read["fields"][field], value), "{name}.{field}: {read}");
        }
    }
    let read: Vec<(MavlinkContent, &Value)> = printed[ours.len() + 1..]
        .iter()
        .flat_map(|line| {
            let bytes = bytes(line["bytes"].as_str().unwrap());
            let packets: Vec<_> = MavlinkDecoder::new().push(&bytes).collect();
            assert_eq!(packets.len(), 1, "{line}");
            packets.into_iter().map(move |packet| (packet.content, line))
        })
        .collect();
    let mut rest = read.iter();
    for wanted in theirs() {
        assert!(rest.any(|(content, _)| *content == wanted), "{wanted:?}");
    }
    check_motion(&read);
}

/// Numbers that are rounded, and texts.
fn check_motion(read: &[(MavlinkContent, &Value)]) {
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let (mut motions, mut texts, mut setpoints) = (0, Vec::new(), 0);
    for (content, _) in read {
        match content {
            MavlinkContent::Attitude(attitude) => {
                assert!(close(&attitude.attitude, &[0.0, 0.0, -half, half]), "{attitude:?}");
                assert!(close(&attitude.rate, &[0.1, -0.2, -0.3]), "{attitude:?}");
                motions += 1;
            }
            MavlinkContent::Position(position) => {
                assert_eq!(position.position, [1.0, -2.0, 3.0]);
                assert_eq!(position.velocity, [0.5, -0.25, 0.125]);
                motions += 1;
            }
            MavlinkContent::Text(text) => texts.push((text.severity, text.text[0])),
            MavlinkContent::AttitudeTarget(target) => {
                let SetpointKind::Rates(rates) = target.kind else { panic!("{target:?}") };
                assert!(close(&rates, &[0.1, -0.2, -0.3]) && close(&[target.thrust], &[0.5]));
                setpoints += 1;
            }
            MavlinkContent::Battery(volts) if volts.is_nan() => motions += 1,
            _ => {}
        }
    }
    assert_eq!((motions, setpoints), (3, 1));
    assert_eq!(texts, [(TextSeverity::Trouble, b'P'), (TextSeverity::Information, b'E')]);
}
