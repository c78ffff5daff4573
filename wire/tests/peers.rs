//! XBee's frames against digi-xbee, and CRTP's packets against cflib, byte for byte, in both directions.
//!
//! Needs an interpreter with `tests/peers/requirements.txt` installed, named by `OQTAL_PEERS_PYTHON`; `.ci/run` installs one.
//! Without the variable the test is skipped with a message. With it, a peer that does not answer is a failure.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use crate::common::{crtp_examples, decode, hex};
use oqtal_wire::xbee::{Api1Grammar, Api2Grammar, ApiFrame, Payload};
use serde::Deserialize;

const PYTHON: &str = "OQTAL_PEERS_PYTHON";

#[derive(Debug, Deserialize)]
struct Example {
    kind: u8,
    fields: Vec<u64>,
    payload: String,
    plain: String,
    escaped: String,
}

impl Example {
    fn frame(&self) -> ApiFrame {
        let payload = Payload::try_from(&hex(&self.payload)[..]).unwrap();
        let long = |index: usize| self.fields[index];
        let short = |index: usize| u16::try_from(self.fields[index]).unwrap();
        let byte = |index: usize| u8::try_from(self.fields[index]).unwrap();
        match self.kind {
            0x10 => ApiFrame::TxRequest {
                id: byte(0),
                to: long(1),
                network: short(2),
                radius: byte(3),
                options: byte(4),
                payload,
            },
            0x01 => ApiFrame::TxRequest16 { id: byte(0), to: short(1), options: byte(2), payload },
            0x90 => {
                ApiFrame::RxPacket { from: long(0), network: short(1), options: byte(2), payload }
            }
            0x80 => {
                ApiFrame::RxPacket64 { from: long(0), rssi: byte(1), options: byte(2), payload }
            }
            0x81 => {
                ApiFrame::RxPacket16 { from: short(0), rssi: byte(1), options: byte(2), payload }
            }
            0x89 => ApiFrame::TxStatus { id: byte(0), status: byte(1) },
            0x8B => ApiFrame::TxStatusExtended {
                id: byte(0),
                network: short(1),
                retries: byte(2),
                delivery: byte(3),
                discovery: byte(4),
            },
            0x8A => ApiFrame::ModemStatus(byte(0)),
            other => panic!("unknown kind {other:#04x}"),
        }
    }
}

/// Output of the script; `None` if there is no peer.
fn peer(script: &str) -> Option<String> {
    let Some(python) = std::env::var_os(PYTHON) else {
        // Directly to standard error: the output of a passing test is not shown.
        let reason =
            format!("{script}: skipped, {PYTHON} names no interpreter; .ci/run installs one\n");
        std::io::stderr().write_all(reason.as_bytes()).unwrap();
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/peers").join(script);
    let output = Command::new(&python).arg(&script).output();
    let output = output.unwrap_or_else(|error| panic!("{PYTHON}={python:?}: {error}"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", script.display());
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn frames_are_those_of_digi_xbee() {
    let Some(printed) = peer("xbee_frames.py") else { return };
    let examples: Vec<Example> =
        printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for kind in [0x10, 0x01, 0x90, 0x80, 0x81, 0x89, 0x8B, 0x8A] {
        let count = examples.iter().filter(|example| example.kind == kind).count();
        assert!(count >= 10, "{count} of kind {kind:#04x}");
    }
    for example in &examples {
        let frame = example.frame();
        let (plain, escaped) = (hex(&example.plain), hex(&example.escaped));
        assert_eq!(frame.to_wire(false).as_bytes(), plain, "{example:?}");
        assert_eq!(frame.to_wire(true).as_bytes(), escaped, "{example:?}");
        assert_eq!(decode::<Api1Grammar>(&plain).0, [frame]);
        assert_eq!(decode::<Api2Grammar>(&escaped).0, [frame]);
    }
}

#[test]
fn packets_are_those_of_cflib() {
    let Some(printed) = peer("crtp_packets.py") else { return };
    crtp_examples::check(&printed);
}
