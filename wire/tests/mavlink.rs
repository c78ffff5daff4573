//! MAVLink: encoded messages are decoded between arbitrary other bytes, with the masks, frames and signs that autopilots need.

use crate::common::{any_bytes, hex};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AckResult, AttitudeTarget, AutopilotFirmware, CommandKind, MAX_PACKET, MavlinkAddress,
    MavlinkAttitude, MavlinkContent, MavlinkDecoder, MavlinkEncoder, MavlinkGrammar,
    MavlinkHeartbeat, MavlinkPacket, MavlinkPose, MavlinkPosition, MavlinkText, ParameterName,
    ParameterValue, SetpointKind, SignatureCheck, SigningKey, TextSeverity, Timesync,
    VehicleCommandLong,
};
use proptest::prelude::*;

const OWN: MavlinkAddress = MavlinkAddress { system: 245, component: MavlinkAddress::COMPUTER };
const VEHICLE: MavlinkAddress = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };

fn decoded(bytes: &[u8]) -> Vec<MavlinkPacket> {
    MavlinkDecoder::new().push(bytes).collect()
}

fn sent(content: MavlinkContent) -> Vec<u8> {
    MavlinkEncoder::new(OWN).encode(&content).unwrap().as_bytes().to_vec()
}

fn name() -> ParameterName {
    ParameterName::new("EK3_SRC1_POSXY").unwrap()
}

/// Every kind of message that has no number to be rounded.
fn samples() -> Vec<MavlinkContent> {
    [states(), orders()].concat()
}

/// States of a vehicle, and messages of a companion to it.
fn states() -> Vec<MavlinkContent> {
    use MavlinkContent as C;
    let heartbeat = MavlinkHeartbeat {
        autopilot: AutopilotFirmware::Known(AutopilotKind::Px4),
        custom_mode: 0x60000,
        is_armed: true,
        is_simulated: false,
    };
    let text = MavlinkText { severity: TextSeverity::Trouble, text: [b'x'; 50], piece: 1 };
    let quarter = std::f64::consts::FRAC_1_SQRT_2 as f32;
    let attitude = [0.0, 0.0, f64::from(quarter), f64::from(quarter)];
    let (position, rate) = ([1.0, 2.0, 0.5], [0.25, -0.5, 0.125]);
    vec![
        C::Heartbeat(heartbeat),
        C::Heartbeat(MavlinkHeartbeat {
            autopilot: AutopilotFirmware::None,
            is_armed: false,
            ..heartbeat
        }),
        C::Battery(11.1),
        C::Timesync(Timesync { answered: 1 << 40, asked: 7 }),
        C::AttitudeTarget(AttitudeTarget {
            target: VEHICLE,
            time_ms: 1234,
            kind: SetpointKind::Rates(rate),
            thrust: 0.375,
        }),
        C::GlobalOrigin { system: 1 },
        C::Text(text),
        C::Position(MavlinkPosition { time_ms: 5, position, velocity: rate }),
        C::Attitude(MavlinkAttitude { time_ms: 5, attitude, rate }),
        C::Estimator(831),
    ]
}

/// Commands, parameters and their answers.
fn orders() -> Vec<MavlinkContent> {
    use MavlinkContent as C;
    let value = ParameterValue { raw: 6.0, is_real: false, code: 2 };
    let command = |kind| C::Command(VehicleCommandLong { target: VEHICLE, kind, confirmation: 1 });
    vec![
        command(CommandKind::SetMode { mode: 6, sub_mode: 0 }),
        command(CommandKind::Arm { run: true, is_forced: false }),
        command(CommandKind::Arm { run: false, is_forced: true }),
        command(CommandKind::MessageInterval { message: 331, interval_us: 20_000 }),
        command(CommandKind::RequestMessage { message: 0 }),
        command(CommandKind::Reboot),
        C::Acknowledged { command: 400, result: AckResult::Failed, target: OWN },
        C::Acknowledged { command: 176, result: AckResult::Accepted, target: MavlinkAddress::ALL },
        C::ParameterRequest { target: VEHICLE, name: name() },
        C::ParameterSet { target: VEHICLE, name: name(), value },
        C::Parameter { name: name(), value },
    ]
}

#[test]
fn every_message_is_read_back() {
    for content in samples() {
        let [packet] = decoded(&sent(content))[..] else { panic!("{content:?}") };
        assert_eq!((packet.from, packet.content), (OWN, content));
    }
}

#[test]
fn packets_are_those_of_the_crate_mavlink() {
    let lines = include_str!("golden/mavlink.txt").lines().filter(|line| !line.starts_with('#'));
    let mut count = 0;
    for line in lines {
        let [received, expected, meaning] = line.splitn(3, ' ').collect::<Vec<_>>()[..] else {
            panic!("{line}")
        };
        let [packet] = decoded(&hex(received))[..] else { panic!("{line}") };
        assert_eq!(format!("{:?}", packet.content), meaning);
        if expected != "-" {
            assert_eq!(sent(packet.content), hex(expected), "{meaning}");
        }
        count += 1;
    }
    assert_eq!(count, 63);
}

/// Payload of the message, filled up with the zeros that are not sent.
fn payload(content: MavlinkContent) -> Vec<u8> {
    let bytes = sent(content);
    let mut payload = bytes[10..10 + usize::from(bytes[1])].to_vec();
    payload.resize(255, 0);
    payload
}

fn float_at(payload: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(payload[at..at + 4].try_into().unwrap())
}

#[test]
fn rates_have_mask_128_and_the_signs_of_forward_right_down() {
    let target = AttitudeTarget {
        target: VEHICLE,
        time_ms: 1,
        kind: SetpointKind::Rates([0.1, 0.2, 0.3]),
        thrust: 0.4,
    };
    let payload = payload(MavlinkContent::AttitudeTarget(target));
    assert_eq!(payload[38], 128);
    let numbers = [4, 8, 12, 16, 20, 24, 28, 32].map(|at| float_at(&payload, at));
    assert_eq!(numbers, [1.0, 0.0, 0.0, 0.0, 0.1, -0.2, -0.3, 0.4]);
}

#[test]
fn an_attitude_has_mask_3_and_unit_length() {
    // A turn about each axis, of a quaternion that is not quite of unit length.
    for (axis, sign) in [(0, 1.0), (1, -1.0), (2, -1.0)] {
        let mut attitude = [0.0, 0.0, 0.0, 0.998];
        attitude[axis] = 0.05;
        let target = AttitudeTarget {
            target: VEHICLE,
            time_ms: 1,
            kind: SetpointKind::Attitude { attitude, yaw_rate: 0.5 },
            thrust: 0.4,
        };
        let payload = payload(MavlinkContent::AttitudeTarget(target));
        assert_eq!(payload[38], 3);
        let q = [4, 8, 12, 16].map(|at| f64::from(float_at(&payload, at)));
        let norm = q.iter().map(|number| number * number).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() < 1e-7, "{norm}");
        assert!(q[0] > 0.9 && sign * q[1 + axis] > 0.04, "{q:?}");
        assert_eq!(float_at(&payload, 28), -0.5, "yaw rate");
    }
}

#[test]
fn an_attitude_for_ardupilot_ignores_no_rate() {
    let kind = SetpointKind::AttitudeAndRates { attitude: [0.0, 0.0, 0.0, 1.0], yaw_rate: 0.5 };
    let target = AttitudeTarget { target: VEHICLE, time_ms: 1, kind, thrust: 0.4 };
    let payload = payload(MavlinkContent::AttitudeTarget(target));
    assert_eq!(payload[38], 0);
    assert_eq!([20, 24, 28].map(|at| float_at(&payload, at)), [0.0, 0.0, -0.5]);
}

fn pose() -> MavlinkPose {
    MavlinkPose {
        time_us: 123_456_789,
        position: [1.0, 2.0, 3.0],
        attitude: [0.1, -0.2, 0.3, 0.927_361_849_549_570_4],
        position_sd_m: 0.001,
        attitude_sd_rad: 0.01,
    }
}

#[test]
fn poses_are_forward_right_down_by_vision_with_their_covariance() {
    let payload = payload(MavlinkContent::Odometry(pose()));
    assert_eq!([8, 12, 16].map(|at| float_at(&payload, at)), [1.0, -2.0, -3.0]);
    assert!(float_at(&payload, 36).is_nan(), "no velocity");
    // Frames 20 and 12, no reset, vision, quality.
    assert_eq!(payload[228..233], [20, 12, 0, 2, 100]);
    assert_eq!(float_at(&payload, 60), 1e-6);
    for content in [MavlinkContent::Odometry(pose()), MavlinkContent::VisionPosition(pose())] {
        let [packet] = decoded(&sent(content))[..] else { panic!("{content:?}") };
        let (MavlinkContent::Odometry(read) | MavlinkContent::VisionPosition(read)) =
            packet.content
        else {
            panic!("{packet:?}")
        };
        assert_eq!((read.time_us, read.position), (pose().time_us, pose().position));
        let apart = read.attitude.iter().zip(pose().attitude).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-6, "{read:?}");
        assert!((read.position_sd_m - 0.001).abs() < 1e-6);
    }
}

#[test]
fn a_signed_packet_is_longer_by_its_signature_and_is_read() {
    let key = SigningKey::from_hex(&"0f".repeat(32)).unwrap();
    let mut encoder = MavlinkEncoder::new(OWN);
    encoder.sign(key, 1_800_000_000_000_000);
    let content = MavlinkContent::Battery(11.1);
    let first = encoder.encode(&content).unwrap().as_bytes().to_vec();
    let second = encoder.encode(&content).unwrap().as_bytes().to_vec();
    assert_eq!(first.len(), sent(content).len() + 13);
    let [packet] = decoded(&first)[..] else { panic!("no packet") };
    assert_eq!(packet.content, content);
    let stamp = |packet: &[u8]| packet[packet.len() - 12];
    assert_ne!(stamp(&first), stamp(&second), "stamps rise");
    for wrong in ["", "0f", &"0g".repeat(32), &"0f".repeat(33)] {
        assert!(SigningKey::from_hex(wrong).is_none());
    }
}

#[test]
fn an_encoder_that_continues_behind_another_one_never_stamps_earlier_than_before() {
    let encoder = |unix_us| {
        let mut encoder = MavlinkEncoder::new(OWN);
        encoder.sign(key("0f"), unix_us);
        encoder
    };
    let (mut early, mut late) = (encoder(NOW_US), encoder(NOW_US + MINUTE_US));
    late.encode(&MavlinkContent::Battery(11.1)).unwrap();
    let [first, second] = [early.position(), late.position()];
    late.continue_at(first);
    assert_eq!(late.position(), (first.0, second.1));
    early.continue_at(second);
    assert_eq!(early.position(), second);
}

/// Unix time of these tests, and a minute \[us\].
const NOW_US: u64 = 1_800_000_000_000_000;
const MINUTE_US: u64 = 60_000_000;

fn key(digits: &str) -> SigningKey {
    SigningKey::from_hex(&digits.repeat(32)).unwrap()
}

#[test]
fn only_packets_signed_with_the_key_are_accepted_and_none_twice() {
    let sender = |key: Option<SigningKey>, from, unix_us| {
        let mut encoder = MavlinkEncoder::new(from);
        if let Some(key) = key {
            encoder.sign(key, unix_us);
        }
        encoder
    };
    let packet = |encoder: &mut MavlinkEncoder| {
        let wire = encoder.encode(&MavlinkContent::Battery(11.1)).unwrap();
        decoded(wire.as_bytes())[0]
    };
    let mut check = SignatureCheck::new(key("0f"), NOW_US);
    let mut accepts = |packet: &MavlinkPacket| check.accepts(packet.from, packet.signed.as_ref());

    assert!(!accepts(&packet(&mut sender(None, VEHICLE, 0))), "not signed");
    assert!(!accepts(&packet(&mut sender(Some(key("1f")), VEHICLE, NOW_US))), "by another key");
    let mut vehicle = sender(Some(key("0f")), VEHICLE, NOW_US);
    let (first, second) = (packet(&mut vehicle), packet(&mut vehicle));
    assert!(accepts(&first));
    assert!(!accepts(&first), "recorded and sent again");
    assert!(accepts(&second));
    assert!(!accepts(&first), "older than the last");
    let old = packet(&mut sender(Some(key("0f")), OWN, NOW_US - 2 * MINUTE_US));
    assert!(!accepts(&old), "first packet, and more than a minute old");
    assert!(accepts(&packet(&mut sender(Some(key("0f")), OWN, NOW_US - MINUTE_US / 2))));
}

#[test]
fn a_sender_whose_clock_was_not_set_is_accepted_after_it_received_a_later_stamp() {
    let packet = |encoder: &mut MavlinkEncoder| {
        let wire = encoder.encode(&MavlinkContent::Battery(11.1)).unwrap();
        decoded(wire.as_bytes())[0]
    };
    let sender = |address, unix_us| {
        let mut encoder = MavlinkEncoder::new(address);
        encoder.sign(key("0f"), unix_us);
        encoder
    };
    let accepts = |check: &mut SignatureCheck, packet: &MavlinkPacket| {
        check.accepts(packet.from, packet.signed.as_ref())
    };
    let (mut vehicle, mut own) = (sender(VEHICLE, NOW_US), sender(OWN, 0));
    let mut by_vehicle = SignatureCheck::new(key("0f"), NOW_US);
    let mut by_own = SignatureCheck::new(key("0f"), 0);
    assert!(!accepts(&mut by_vehicle, &packet(&mut own)), "of 1970");
    assert!(accepts(&mut by_own, &packet(&mut vehicle)));
    own.follow(&by_own);
    for _ in 0..3 {
        assert!(accepts(&mut by_vehicle, &packet(&mut own)));
    }
    // A clock that is ahead stays so.
    let mut ahead = sender(OWN, NOW_US + MINUTE_US);
    ahead.follow(&by_own);
    assert!(accepts(&mut by_vehicle, &packet(&mut ahead)));
}

#[test]
fn a_damaged_packet_affects_only_itself_and_an_unknown_one_is_skipped() {
    let good = sent(MavlinkContent::Battery(11.1));
    for bit in 0..8 * good.len() {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        bytes.extend(&good);
        bytes.extend(&good);
        // A wrong length may take what follows until the checksum shows it.
        bytes.extend([0; MAX_PACKET]);
        let packets = decoded(&bytes);
        assert!((1..=3).contains(&packets.len()), "bit {bit}: {packets:?}");
        let good = packets.iter().filter(|p| p.content == MavlinkContent::Battery(11.1));
        assert!(good.count() >= 1, "bit {bit}");
    }
    let mut unknown = vec![0xfd, 4, 0, 0, 0, 1, 1, 0x39, 0x30, 0, 1, 2, 3, 4, 0, 0];
    unknown.extend(&good);
    assert_eq!(decoded(&unknown).len(), 1);
}

#[test]
fn noise_that_looks_like_an_unknown_packet_costs_no_packet_behind_it() {
    let good = sent(MavlinkContent::Battery(11.1));
    for missing in 1..12 {
        let mut bytes = vec![0xfd, 0, 0, 0, 0, 1, 1, 0x39, 0x30, 0, 0, 0];
        bytes.truncate(bytes.len() - missing);
        bytes.extend(&good);
        bytes.extend([0; MAX_PACKET]);
        assert_eq!(decoded(&bytes).len(), 1, "{missing} bytes are missing");
    }
}

/// Noise, packets, parts of packets, and heads of packets.
fn piece() -> impl Strategy<Value = Vec<u8>> {
    let packet = || (0..samples().len()).prop_map(|index| sent(samples()[index]));
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..60),
        packet(),
        (packet(), 0.0..1.0).prop_map(|(packet, share)| {
            packet[..(share * packet.len() as f64) as usize].to_vec()
        }),
        prop::array::uniform9(0..4_u8).prop_map(|head| [&[0xfd], &head[..]].concat()),
    ]
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_decoded_within_bounds(
        pieces in prop::collection::vec(piece(), 1..40),
    ) {
        let bytes = pieces.concat();
        prop_assume!(!bytes.is_empty());
        any_bytes::any_bytes::<MavlinkGrammar>(&bytes);
    }

    #[test]
    fn packets_are_found_in_any_pieces(cuts in prop::collection::vec(1..90_usize, 1..60)) {
        let mut encoder = MavlinkEncoder::new(OWN);
        let all: Vec<u8> = samples()
            .iter()
            .flat_map(|content| encoder.encode(content).unwrap().as_bytes().to_vec())
            .collect();
        let mut decoder = MavlinkDecoder::new();
        let (mut found, mut rest, mut cuts) = (Vec::new(), &all[..], cuts.into_iter().cycle());
        while !rest.is_empty() {
            let (piece, behind) = rest.split_at(cuts.next().unwrap().min(rest.len()));
            found.extend(decoder.push(piece).map(|packet| packet.content));
            rest = behind;
        }
        prop_assert_eq!(found, samples());
    }
}
