//! Arbitrary bytes into every decoder.

use crate::common::any_bytes::{any_bytes, any_radio_bytes};
use crate::common::any_crtp_bytes::any_crtp_bytes;
use crate::common::noise;
use oqtal_wire::asctec::{HostGrammar, VehicleGrammar};
use oqtal_wire::msp::MspGrammar;
use oqtal_wire::xbee::{ApiFrame, Payload};
use proptest::prelude::*;

/// A few bytes repeated: slow for a decoder that inspects them too often.
fn repeated() -> impl Strategy<Value = Vec<u8>> {
    let telling = prop::sample::select(vec![
        b">".to_vec(),
        b">*".to_vec(),
        b">a".to_vec(),
        b">*>".to_vec(),
        b">*>di".to_vec(),
        // Heads of the longest telemetry frame, close together, with end marks where theirs would be.
        b">*>\x5c\x00\x03".to_vec(),
        b">*>\x5c\x00\x03<#<".to_vec(),
        // Heads of the longest packet of MSP.
        b"$M>\xfe".to_vec(),
        b"$M>\xfe$".to_vec(),
        b"\x7e".to_vec(),
        b"\x7e\x00".to_vec(),
        b"\x7e\x00\x72".to_vec(),
        // A head of the longest frame, followed by escapes alone.
        [b"\x7e\x00\x72".to_vec(), b"\x7d\x5e".repeat(115)].concat(),
        [b"\x7e\x00\x72".to_vec(), b"\x7d".repeat(115)].concat(),
    ]);
    (telling, 1..300_usize).prop_map(|(bytes, times)| bytes.repeat(times))
}

fn bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..2000),
        prop::collection::vec(noise(), 0..10).prop_map(|parts| parts.concat()),
        repeated(),
    ]
}

proptest! {
    #[test]
    fn a_host_stays_sound(bytes in bytes()) {
        any_bytes::<HostGrammar>(&bytes);
    }

    #[test]
    fn a_vehicle_stays_sound(bytes in bytes()) {
        any_bytes::<VehicleGrammar>(&bytes);
    }

    #[test]
    fn both_ends_of_msp_stay_sound(bytes in bytes()) {
        any_bytes::<MspGrammar>(&bytes);
    }

    #[test]
    fn a_radio_and_its_host_stay_sound(bytes in bytes()) {
        any_radio_bytes(&bytes);
    }

    #[test]
    fn both_ends_of_crtp_stay_sound(
        header in any::<u8>(),
        command in 0..16_u8,
        rest in prop::collection::vec(any::<u8>(), 0..32),
    ) {
        any_crtp_bytes(&rest);
        any_crtp_bytes(&[&[header, command], &rest[..]].concat());
    }

    #[test]
    fn a_frame_cut_anywhere_in_a_stream_of_escapes_stays_sound(cut in 0..235_usize, times in 1..4_usize) {
        let payload = Payload::try_from(&[0x7D; 100][..]).unwrap();
        let frame = ApiFrame::RxPacket16 { from: 0x7E7E, rssi: 0x11, options: 0x13, payload };
        let wire = frame.to_wire(true);
        let part = &wire.as_bytes()[..cut.min(wire.as_bytes().len())];
        any_radio_bytes(&[&part.repeat(times), wire.as_bytes()].concat());
    }
}
