//! Arbitrary bytes into the MAVLink decoder, and what it reads back through the encoder.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/any_bytes.rs"]
mod any_bytes;

use libfuzzer_sys::fuzz_target;
use oqtal_wire::mavlink::{MavlinkAddress, MavlinkDecoder, MavlinkEncoder, MavlinkGrammar};

fuzz_target!(|bytes: &[u8]| {
    any_bytes::any_bytes::<MavlinkGrammar>(bytes);
    let mut encoder = MavlinkEncoder::new(MavlinkAddress { system: 1, component: 1 });
    for packet in MavlinkDecoder::new().push(bytes) {
        let _ = encoder.encode(&packet.content);
    }
});
