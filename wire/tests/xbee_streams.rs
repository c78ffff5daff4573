//! XBee's decoders and carriers on streams that hold more than good frames.

use crate::common::{decode, decode_in_pieces, in_order, noise};
use oqtal_wire::stream::Grammar;
use oqtal_wire::xbee::{
    Address, Api1Grammar, Api2Grammar, ApiFrame, Carrier, Framing, MAX_PAYLOAD, MAX_WIRE, Payload,
    RadioEvent, Side,
};
use proptest::prelude::*;

fn payload() -> impl Strategy<Value = Payload> {
    let special = prop::sample::select(vec![0x7E_u8, 0x7D, 0x11, 0x13, b'>']);
    prop::collection::vec(prop_oneof![any::<u8>(), special], 0..=MAX_PAYLOAD)
        .prop_map(|bytes| Payload::try_from(&bytes[..]).unwrap())
}

fn with_payload() -> impl Strategy<Value = ApiFrame> {
    let (byte, short, long) = (any::<u8>, any::<u16>, any::<u64>);
    prop_oneof![
        (byte(), long(), short(), any::<[u8; 2]>(), payload()).prop_map(
            |(id, to, network, [radius, options], payload)| ApiFrame::TxRequest {
                id,
                to,
                network,
                radius,
                options,
                payload
            }
        ),
        (byte(), short(), byte(), payload()).prop_map(|(id, to, options, payload)| {
            ApiFrame::TxRequest16 { id, to, options, payload }
        }),
        (long(), short(), byte(), payload()).prop_map(|(from, network, options, payload)| {
            ApiFrame::RxPacket { from, network, options, payload }
        }),
        (long(), byte(), byte(), payload()).prop_map(|(from, rssi, options, payload)| {
            ApiFrame::RxPacket64 { from, rssi, options, payload }
        }),
        (short(), byte(), byte(), payload()).prop_map(|(from, rssi, options, payload)| {
            ApiFrame::RxPacket16 { from, rssi, options, payload }
        }),
    ]
}

fn frame() -> impl Strategy<Value = ApiFrame> {
    prop_oneof![
        with_payload(),
        any::<[u8; 2]>().prop_map(|[id, status]| ApiFrame::TxStatus { id, status }),
        (any::<u8>(), any::<u16>(), any::<[u8; 3]>()).prop_map(
            |(id, network, [retries, delivery, discovery])| ApiFrame::TxStatusExtended {
                id,
                network,
                retries,
                delivery,
                discovery
            }
        ),
        any::<u8>().prop_map(ApiFrame::ModemStatus),
    ]
}

/// Frames, each with noise before it, and zeros at the end.
fn stream(escaped: bool) -> impl Strategy<Value = (Vec<u8>, Vec<ApiFrame>)> {
    prop::collection::vec((noise(), frame()), 0..6).prop_map(move |parts| {
        let (mut bytes, mut frames) = (Vec::new(), Vec::new());
        for (noise, frame) in parts {
            bytes.extend(noise);
            bytes.extend(frame.to_wire(escaped).as_bytes());
            frames.push(frame);
        }
        bytes.extend([0; MAX_WIRE]);
        (bytes, frames)
    })
}

/// Frames one after another without noise.
fn back_to_back<G: Grammar<Event = ApiFrame>>(frames: &[ApiFrame], escaped: bool) -> Vec<ApiFrame> {
    let bytes: Vec<u8> =
        frames.iter().flat_map(|frame| frame.to_wire(escaped).as_bytes().to_vec()).collect();
    let (events, counters) = decode::<G>(&bytes);
    assert_eq!((counters.damaged, counters.skipped), (0, 0));
    events
}

fn carriers() -> impl Strategy<Value = (Framing, Address)> {
    let framing = prop::sample::select(vec![Framing::Transparent, Framing::Api1, Framing::Api2]);
    let address =
        prop_oneof![any::<u16>().prop_map(Address::Short), any::<u64>().prop_map(Address::Long)];
    (framing, address)
}

/// Payload of the events, concatenated.
fn bytes_of(arrivals: impl Iterator<Item = RadioEvent>) -> Vec<u8> {
    arrivals
        .flat_map(|arrival| match arrival {
            RadioEvent::Payload { payload, .. } => payload.to_vec(),
            other => panic!("{other:?}"),
        })
        .collect()
}

proptest! {
    #[test]
    fn frames_are_read_as_they_were_written(frames in prop::collection::vec(frame(), 0..6)) {
        prop_assert_eq!(&back_to_back::<Api1Grammar>(&frames, false), &frames);
        prop_assert_eq!(&back_to_back::<Api2Grammar>(&frames, true), &frames);
    }

    #[test]
    fn an_escaped_frame_has_one_start_byte_and_no_flow_control(frame in frame()) {
        let wire = frame.to_wire(true);
        prop_assert_eq!(wire.as_bytes()[0], 0x7E);
        prop_assert!(!wire.as_bytes()[1..].iter().any(|byte| [0x7E, 0x11, 0x13].contains(byte)));
    }

    #[test]
    fn one_wrong_bit_is_never_accepted(frame in frame(), bit in any::<prop::sample::Index>()) {
        let mut bytes = frame.to_wire(false).as_bytes().to_vec();
        // A wrong bit in the length moves the checksum to another place, where one sum in 256 is right.
        let bit = 24 + bit.index((bytes.len() - 3) * 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        bytes.extend([0; MAX_WIRE]);
        prop_assert!(!decode::<Api1Grammar>(&bytes).0.contains(&frame));
    }

    #[test]
    fn good_frames_are_found_in_noise((bytes, wanted) in stream(true)) {
        let (found, _) = decode::<Api2Grammar>(&bytes);
        prop_assert!(in_order(&wanted, &found), "{wanted:?}\n{found:?}");
    }

    #[test]
    fn the_split_of_the_bytes_does_not_matter(
        (plain, _) in stream(false),
        (escaped, _) in stream(true),
        pieces in prop::collection::vec(0..40_usize, 0..60),
    ) {
        let whole = decode::<Api1Grammar>(&plain);
        prop_assert_eq!(whole, decode_in_pieces::<Api1Grammar>(&plain, &pieces));
        let whole = decode::<Api2Grammar>(&escaped);
        prop_assert_eq!(whole, decode_in_pieces::<Api2Grammar>(&escaped, &pieces));
    }

    #[test]
    fn payload_arrives_at_the_other_side_both_ways(
        (framing, address) in carriers(),
        sent in prop::collection::vec(payload(), 0..5),
    ) {
        for (from, to) in [(Side::Host, Side::Radio), (Side::Radio, Side::Host)] {
            let sender = Carrier::new(framing, from, address);
            let mut receiver = Carrier::new(framing, to, address);
            let wire: Vec<u8> = sent
                .iter()
                .flat_map(|payload| sender.wrap(0, payload).unwrap().as_bytes().to_vec())
                .collect();
            let whole: Vec<u8> = sent.iter().flat_map(|payload| payload.to_vec()).collect();
            prop_assert_eq!(bytes_of(receiver.push(&wire)), whole);
            // A side ignores its own frames, except without framing.
            let mut echo = Carrier::new(framing, from, address);
            let echoed = bytes_of(echo.push(&wire));
            prop_assert!(framing == Framing::Transparent || echoed.is_empty());
        }
    }

    #[test]
    fn overhead_equals_the_bytes_added_by_framing((framing, address) in carriers(), payload in payload()) {
        for side in [Side::Host, Side::Radio] {
            let carrier = Carrier::new(framing, side, address);
            let length = carrier.wrap(1, &payload).unwrap().as_bytes().len();
            let plain = payload.len() + carrier.overhead();
            let escapes = length - plain;
            prop_assert!(escapes == 0 || framing == Framing::Api2, "{escapes} bytes more");
        }
    }

    #[test]
    fn a_report_gives_the_host_the_delivery_of_its_request(
        (framing, address) in carriers(),
        id: u8,
        delivered: bool,
    ) {
        let radio = Carrier::new(framing, Side::Radio, address);
        let mut host = Carrier::new(framing, Side::Host, address);
        let reported: Vec<RadioEvent> = host.push(radio.report(id, delivered).as_bytes()).collect();
        let silent = framing == Framing::Transparent || id == 0;
        let wanted = (!silent).then_some(RadioEvent::Delivery { id, delivered });
        prop_assert_eq!(reported, Vec::from_iter(wanted));
    }
}

#[test]
fn more_than_a_radio_packet_holds_is_refused() {
    let carrier = Carrier::new(Framing::Api1, Side::Host, Address::BROADCAST);
    let error = carrier.wrap(0, &[0; MAX_PAYLOAD + 1]).unwrap_err();
    assert_eq!(error.to_string(), "101 bytes of payload, a radio packet holds 100");
}

#[test]
fn a_request_carries_its_number_to_the_radio() {
    let host = Carrier::new(Framing::Api2, Side::Host, Address::Short(1));
    let mut radio = Carrier::new(Framing::Api2, Side::Radio, Address::Short(2));
    let received: Vec<RadioEvent> = radio.push(host.wrap(17, b"up").unwrap().as_bytes()).collect();
    let payload = Payload::try_from(&b"up"[..]).unwrap();
    assert_eq!(received, [RadioEvent::Payload { id: 17, payload }]);
}

#[test]
fn a_host_accepts_its_peer_alone_unless_that_is_the_broadcast_address() {
    let (one, other) = (Address::Long(0x0013_A200_4052_1234), Address::Long(0x0013_A200_4052_1235));
    let (short, every_short) = (Address::Short(0x1234), Address::Short(0xFFFF));
    for (peer, from, receives) in [
        (one, one, true),
        (one, other, false),
        (one, short, false),
        (short, short, true),
        (short, Address::Short(0x1235), false),
        (Address::BROADCAST, other, true),
        (every_short, one, true),
    ] {
        let wire = Carrier::new(Framing::Api2, Side::Radio, from).wrap(0, b">a\x17a<").unwrap();
        let mut host = Carrier::new(Framing::Api2, Side::Host, peer);
        let received = host.push(wire.as_bytes()).count();
        assert_eq!(received, usize::from(receives), "{peer:?} receives {from:?}");
    }
}
