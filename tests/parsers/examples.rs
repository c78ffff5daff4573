//! Valid examples for every parser.

use std::process::{Command, Stdio};

use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MarkerSample, MotionFrame, RigidPose};
use oqtal_wire::natnet::{NatNetServer, NatNetServerOptions};
use oqtal_wire::qtm::{ComponentKind, ComponentSet, QtmEvent, QtmWriter};
use oqtal_wire::vrpn::VrpnSession;

/// Size of the example of a recording \[bytes\]: facts, channels and two chunks.
const RECORDING_BYTES: usize = 200_000;
/// Magic bytes of an MCAP file; opcode and length of a record.
const MAGIC_BYTES: usize = 8;
const HEAD_BYTES: usize = 9;

/// The beginning of a recording of a flight, without checksums, so that mutations behind them are read as well.
pub fn recording() -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
    command.args(["fly", "--clock", "in-process", "--trajectory", "hover", "--duration", "0.2"]);
    command.args(["--set", "record.flights=all", "--out", "d"]);
    let flight = command.current_dir(&directory).stdout(Stdio::null()).status().unwrap();
    assert!(flight.success());
    let mut bytes = std::fs::read(directory.path().join("d/flight.mcap")).unwrap();
    bytes.truncate(RECORDING_BYTES);
    let mut at = MAGIC_BYTES;
    while let Some(head) = bytes.get(at..at + HEAD_BYTES) {
        let (opcode, body) = (head[0], at + HEAD_BYTES);
        let end = body + u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        let checksum = match opcode {
            0x06 => body + 24..body + 28,
            0x09 => end - 4..end,
            _ => body..body,
        };
        if let Some(checksum) = bytes.get_mut(checksum) {
            checksum.fill(0);
        }
        at = end;
    }
    bytes
}

/// Camera recordings in each format.
pub fn poses() -> Vec<String> {
    let row = |i: usize, separator: &str| {
        let time = format!("{}", 1.0 + 0.01 * i as f64);
        [&*time, "0.1", "-0.2", "1.0", "0", "0", "0", "1"].join(separator)
    };
    let rows = |separator| (0..50).map(move |i| row(i, separator) + "\n").collect::<String>();
    let named = format!("t,x,y,z,qx,qy,qz,qw\n{}", rows(","));
    let euroc = "#timestamp, p_RS_R_x [m]\n".to_owned()
        + &(0..50).map(|i| format!("{i}0000000,0,0,1,1,0,0,0\n")).collect::<String>();
    vec![named, rows(" "), euroc]
}

/// Waypoints.
pub fn waypoints() -> String {
    let rows = (0..20).map(|i| format!("{}.5,0.1,-0.2,1.0,90\n", i));
    format!("t,x,y,z,yaw_deg\n{}", rows.collect::<String>())
}

/// A frame of two bodies and three markers in QTM's, VRPN's and NatNet's form.
pub fn camera_streams() -> [Vec<u8>; 3] {
    let pose = RigidPose::new([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    let bodies = [BodySample { pose, ..BodySample::LOST }, BodySample::LOST];
    let markers = &[MarkerSample { position_m: Some([1.0; 3]), residual_m: 0.001 }; 3];
    let frame = MotionFrame { number: 1, captured_ns: 5, sent_ns: 6, bodies: &bodies, markers };
    let (mut qtm, mut vrpn, mut natnet) = (Vec::new(), Vec::new(), Vec::new());
    let mut writer = QtmWriter::new(&mut qtm, ByteOrder::Little);
    writer.command("QTM RT Interface connected");
    writer.event(QtmEvent::Connected);
    writer.xml("<P><The_6D><Bodies>1</Bodies><Body><Name>a&amp;b</Name></Body></The_6D></P>");
    writer.data(
        &frame,
        &ComponentKind::ALL.into_iter().fold(ComponentSet::new(), ComponentSet::with),
    );
    let mut session = VrpnSession::open(&["cf1".to_owned()], &mut vrpn);
    let cookie = vrpn.split_off(0);
    session.receive(&cookie, &mut vrpn).unwrap();
    session.write_frame(&frame, &mut vrpn);
    NatNetServer::new(NatNetServerOptions::default()).write_frame(&frame, None, &mut natnet);
    [qtm, vrpn, natnet]
}

/// Heads and end marks of the vehicles' frames, close together.
pub fn heads_of_frames() -> Vec<u8> {
    b">*>\x5c\x00\x03<#<>*>di\x7e\x00\x72\x7d\x5e\xfd\x09\x00\x00$M>\xfe".repeat(100)
}
