//! MSP against bytes of others: requests of YAMSPy 0.3.3, and replies of Betaflight 2025.12.6, which ran as a program.

use crate::common::{decode, hex};
use oqtal_wire::msp::{
    MSP_ARM, MspChannelMap, MspGrammar, MspKind, MspModeRange, MspPacket, MspStatus, MspSticks,
    arming_obstacle, battery_v, command,
};
use proptest::prelude::*;

/// Reply of Betaflight to this command.
fn reply(number: u8, bytes: &str) -> MspPacket {
    let (packets, counters) = decode::<MspGrammar>(&hex(bytes));
    let [packet] = packets[..] else { panic!("{packets:?}, {counters:?}") };
    assert_eq!((packet.kind, packet.command), (MspKind::Reply, number));
    assert_eq!(packet.as_bytes(), hex(bytes), "written as it was read");
    packet
}

#[test]
fn requests_are_those_of_yamspy() {
    let sticks = MspSticks { deflections: [0.5, -0.25, -0.05], throttle: 200.0 / 950.0 };
    let channels = sticks.payload(MspChannelMap::read(&[0, 1, 2, 3]).unwrap(), Some((0, 2000)));
    for (packet, bytes) in [
        (
            MspPacket::request(command::CHANNELS, &channels),
            "244d3c20c8d6065f05f505e204d007e803e803e803e803e803e803e803e803e803e803e80348",
        ),
        (MspPacket::request(command::STATUS, &[]), "244d3c009696"),
        (MspPacket::request(command::SAVE, &[]), "244d3c00fafa"),
        (
            MspPacket::request(command::SET_MODE_RANGE, &[0, MSP_ARM, 0, 32, 48]),
            "244d3c0523000000203036",
        ),
    ] {
        assert_eq!(packet.as_bytes(), hex(bytes), "{packet:?}");
    }
}

#[test]
fn replies_of_betaflight_are_read() {
    let status = |bytes| MspStatus::read(reply(command::STATUS, bytes).payload()).unwrap();
    let lost = status("244d3e19967e0000002300000000000000000400001d0400000000000004cb");
    assert!(!lost.is_armed());
    assert_eq!(arming_obstacle(&lost), Some("RXLOSS"));
    // The arming switch, bit 28 of 29, is not a reason of its own.
    let early = status("244d3e1996600000002300000000000000000400001d0800001000000004c9");
    assert_eq!(arming_obstacle(&early), Some("NOT_DISARMED"));
    let switch = MspStatus { obstacles: 1 << 28, ..early };
    assert_eq!((arming_obstacle(&switch), arming_obstacle(&MspStatus::default())), (None, None));
    let further = MspStatus { modes: 5 | 1 << 40, ..early };
    assert_eq!(MspStatus::read(&further.payload()), Some(further));

    let map = reply(command::CHANNEL_MAP, "244d3e0840000103020405060748");
    assert_eq!(MspChannelMap::read(map.payload()), Some(MspChannelMap::FACTORY));
    let first = reply(command::FIRMWARE, "244d3e04024254464c1a");
    assert_eq!(first.payload(), b"BTFL");
    let none = reply(command::BATTERY, "244d3e096e00000000000000000067");
    assert_eq!(battery_v(none.payload()), None);
    assert_eq!(battery_v(&[168, 0, 0, 0, 0, 0, 0, 0x8F, 6]), Some(16.79));
    assert_eq!(battery_v(&[168, 0, 0, 0, 0, 0, 0]), Some(16.8), "of older versions");
}

#[test]
fn the_range_of_the_arming_switch_is_read() {
    let bytes = "244d3e5022000020300000".to_owned() + &"00".repeat(74) + "62";
    let ranges = reply(command::MODE_RANGES, &bytes);
    let used: Vec<_> =
        MspModeRange::all(ranges.payload()).filter(|range| range.low < range.high).collect();
    assert_eq!(used, [MspModeRange { mode: MSP_ARM, channel: 0, low: 32, high: 48 }]);
    let [range] = used[..] else { panic!() };
    assert_eq!(range.middle_us(), 1900);
    assert!(range.contains(1700) && !range.contains(1699) && !range.contains(2100));
}

#[test]
fn an_unknown_request_is_refused() {
    let (packets, _) = decode::<MspGrammar>(&hex("244d2100c9c9"));
    assert_eq!(packets, [MspPacket::new(MspKind::Refusal, 201, &[])]);
}

#[test]
fn a_damaged_packet_is_counted_and_the_next_one_read() {
    let (packets, counters) = decode::<MspGrammar>(&hex("244d3e0402424f464c1a244d3e00c8c8"));
    assert_eq!(packets, [MspPacket::new(MspKind::Reply, command::CHANNELS, &[])]);
    assert_eq!(counters.damaged, 1);
}

#[test]
fn a_map_that_does_not_order_four_channels_is_refused() {
    for map in [&[0, 1, 3][..], &[0, 1, 3, 3], &[0, 1, 3, 4]] {
        assert_eq!(MspChannelMap::read(map), None, "{map:?}");
    }
}

proptest! {
    #[test]
    fn sticks_are_read_back_to_a_microsecond(
        deflections in prop::array::uniform3(-1.0..1.0),
        throttle in 0.0..1.0,
        order in Just([0_u8, 1, 2, 3]).prop_shuffle(),
        switch in 900..2100_u16,
    ) {
        let (map, sticks) = (MspChannelMap::read(&order).unwrap(), MspSticks { deflections, throttle });
        let (read, switches) = MspSticks::read(&sticks.payload(map, Some((3, switch))), map).unwrap();
        for (read, sent) in read.deflections.iter().zip(deflections) {
            prop_assert!((read - sent).abs() <= 0.5 / 500.0 + 1e-12);
        }
        prop_assert!((read.throttle - throttle).abs() <= 0.5 / 950.0 + 1e-12);
        prop_assert_eq!((switches[3], switches[0]), (switch, 1000));
        // Without a switch no channel moves.
        let (_, switches) = MspSticks::read(&sticks.payload(map, None), map).unwrap();
        prop_assert_eq!(switches, [1000; 12]);
    }
}
