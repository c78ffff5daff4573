//! XBee's frames against bytes of digi-xbee 1.5.0.

use crate::common::{decode, hex};
use oqtal_wire::xbee::{
    Api1Grammar, Api2Grammar, ApiFrame, ApiPacket, MAX_PAYLOAD, MAX_WIRE, Payload, UNKNOWN_NETWORK,
};

fn payload(bytes: &[u8]) -> Payload {
    Payload::try_from(bytes).unwrap()
}

fn request() -> ApiFrame {
    ApiFrame::TxRequest {
        id: 1,
        to: 0x0013_A200_4011_1111,
        network: UNKNOWN_NETWORK,
        radius: 0,
        options: 0,
        payload: payload(&hex("3e2a3e64697e11137d")),
    }
}

/// A frame, plain and escaped.
fn references() -> Vec<(ApiFrame, &'static str, &'static str)> {
    let plain = "7e 0017 10 01 0013a20040111111 fffe 00 00 3e2a3e64697e11137d 37";
    let escaped = "7e00171001007d33a200407d317d317d31fffe00003e2a3e64697d5e7d317d337d5d37";
    let request_16 = ApiFrame::TxRequest16 { id: 1, to: 2, options: 0, payload: payload(b"hi") };
    let received =
        ApiFrame::RxPacket16 { from: 2, rssi: 0x28, options: 0, payload: payload(b"hello") };
    let status = ApiFrame::TxStatus { id: 1, status: 0 };
    vec![
        (request(), plain, escaped),
        (request_16, "7e0007010100020068692a", "7e0007010100020068692a"),
        (received, "7e000a810002280068656c6c6f40", "7e000a810002280068656c6c6f40"),
        (status, "7e0003890100 75", "7e0003890100 75"),
    ]
}

#[test]
fn frames_are_the_references() {
    for (frame, plain, escaped) in references() {
        assert_eq!(frame.to_wire(false).as_bytes(), hex(plain), "{frame:?}");
        assert_eq!(frame.to_wire(true).as_bytes(), hex(escaped), "{frame:?}");
        let bytes = hex(plain);
        assert_eq!(ApiFrame::parse(&ApiPacket::new_checked(&bytes).unwrap()), Ok(frame));
        assert_eq!(decode::<Api1Grammar>(&bytes).0, [frame]);
        assert_eq!(decode::<Api2Grammar>(&hex(escaped)).0, [frame]);
    }
}

#[test]
fn the_greatest_frame_fits() {
    let payload = payload(&[0x7E; MAX_PAYLOAD]);
    let ApiFrame::TxRequest { id, network, radius, options, .. } = request() else {
        unreachable!()
    };
    // Address and payload consist of bytes to escape.
    let to = 0x7E7D_1113_7E7D_1113;
    let frame = ApiFrame::TxRequest { id, to, network, radius, options, payload };
    let wire = frame.to_wire(true);
    assert!(wire.as_bytes().len() <= MAX_WIRE);
    assert_eq!(decode::<Api2Grammar>(wire.as_bytes()).0, [frame]);
    assert_eq!(decode::<Api1Grammar>(frame.to_wire(false).as_bytes()).0, [frame]);
}

#[test]
fn a_good_frame_of_an_unsupported_kind_is_skipped_whole() {
    // An AT command response (0x88) that contains a start byte.
    let stream = hex("7e 0005 88 01 4449 7e 6b");
    let (events, counters) = decode::<Api1Grammar>(&stream);
    assert_eq!(events, []);
    assert_eq!((counters.frames, counters.damaged, counters.skipped), (1, 0, 0));
}
