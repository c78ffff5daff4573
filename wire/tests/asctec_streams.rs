//! AscTec's decoders on streams that hold more than good frames.

use crate::common::{decode, decode_in_pieces, in_order, noise};
use oqtal_wire::asctec::{
    ControlInput, Descriptor, EMERGENCY_STOP, FULL_STICK, FULL_THRUST, HostCommand, HostEvent,
    HostGrammar, ImuCalc, LlStatus, MAX_TELEMETRY, Poll, VehicleGrammar, acknowledgement_frame,
    poll_frame, write_telemetry,
};
use proptest::prelude::*;

fn control_input() -> impl Strategy<Value = ControlInput> {
    let stick = || -FULL_STICK..=FULL_STICK;
    (stick(), stick(), stick(), 0..=FULL_THRUST, 0..=ControlInput::ENABLE_ALL).prop_map(
        |(pitch, roll, yaw, thrust, enabled)| ControlInput { pitch, roll, yaw, thrust, enabled },
    )
}

fn command() -> impl Strategy<Value = (Vec<u8>, HostCommand)> {
    let poll = any::<u16>().prop_filter_map("a poll", Poll::from_wire);
    prop_oneof![
        4 => control_input().prop_map(|input| (input.frame().to_vec(), HostCommand::Control(input))),
        2 => poll.prop_map(|poll| (poll_frame(poll).to_vec(), HostCommand::Poll(poll))),
        1 => Just((EMERGENCY_STOP.to_vec(), HostCommand::EmergencyStop)),
    ]
}

fn telemetry(descriptor: Descriptor, payload: &[u8]) -> Vec<u8> {
    let mut frame = [0; MAX_TELEMETRY];
    let length = write_telemetry(descriptor, payload, &mut frame).unwrap();
    frame[..length].to_vec()
}

fn vehicle_frame() -> impl Strategy<Value = (Vec<u8>, HostEvent)> {
    let payload = |length| prop::collection::vec(any::<u8>(), length);
    let other = Descriptor::ControllerOutput;
    let acknowledgement = Descriptor::ControlInput;
    prop_oneof![
        Just((
            acknowledgement_frame(acknowledgement).to_vec(),
            HostEvent::Acknowledged(acknowledgement)
        )),
        payload(LlStatus::LEN).prop_map(|payload| (
            telemetry(Descriptor::LlStatus, &payload),
            HostEvent::LlStatus(LlStatus::parse(&payload).unwrap())
        )),
        payload(ImuCalc::LEN).prop_map(|payload| (
            telemetry(Descriptor::ImuCalc, &payload),
            HostEvent::ImuCalc(ImuCalc::parse(&payload).unwrap())
        )),
        payload(other.payload_len())
            .prop_map(move |payload| (telemetry(other, &payload), HostEvent::Other(other))),
    ]
}

/// Frames, each with noise before it, and their content.
fn stream<E: std::fmt::Debug>(
    frame: impl Strategy<Value = (Vec<u8>, E)>,
) -> impl Strategy<Value = (Vec<u8>, Vec<E>)> {
    prop::collection::vec((noise(), frame), 0..8).prop_map(|parts| {
        let (mut bytes, mut events) = (Vec::new(), Vec::new());
        for (noise, (frame, event)) in parts {
            bytes.extend(noise);
            bytes.extend(frame);
            events.push(event);
        }
        // Zeros at the end: a candidate that waits for more bytes is completed and rejected.
        bytes.extend([0; MAX_TELEMETRY]);
        (bytes, events)
    })
}

proptest! {
    #[test]
    fn a_command_is_read_as_it_was_written((frame, command) in command()) {
        let (events, counters) = decode::<VehicleGrammar>(&frame);
        prop_assert_eq!(events, [command]);
        prop_assert_eq!((counters.frames, counters.damaged, counters.skipped), (1, 0, 0));
    }

    #[test]
    fn telemetry_is_read_as_it_was_written((frame, event) in vehicle_frame()) {
        let (events, counters) = decode::<HostGrammar>(&frame);
        prop_assert_eq!(events, [event]);
        prop_assert_eq!((counters.frames, counters.damaged, counters.skipped), (1, 0, 0));
    }

    #[test]
    fn payloads_are_read_as_they_were_written(
        status in prop::collection::vec(any::<u8>(), LlStatus::LEN),
        imu in prop::collection::vec(any::<u8>(), ImuCalc::LEN),
    ) {
        prop_assert_eq!(LlStatus::parse(&status).unwrap().payload().to_vec(), status.clone());
        prop_assert_eq!(ImuCalc::parse(&imu).unwrap().payload().to_vec(), imu);
        prop_assert_eq!(LlStatus::parse(&status[1..]), None);
    }

    #[test]
    fn one_wrong_bit_is_never_accepted_in_telemetry(
        (mut frame, _) in vehicle_frame(),
        bit in any::<prop::sample::Index>(),
    ) {
        let bit = bit.index(frame.len() * 8);
        frame[bit / 8] ^= 1 << (bit % 8);
        frame.extend([0; MAX_TELEMETRY]);
        prop_assert_eq!(decode::<HostGrammar>(&frame).0, []);
    }

    /// The CRC's polynomial detects any three wrong bits in frames as short as these.
    #[test]
    fn up_to_three_wrong_bits_under_the_crc_are_never_accepted(
        payload in prop::collection::vec(any::<u8>(), ImuCalc::LEN),
        bits in prop::collection::btree_set(0..(ImuCalc::LEN + 2) * 8, 1..=3),
    ) {
        let mut frame = telemetry(Descriptor::ImuCalc, &payload);
        bits.iter().for_each(|bit| frame[6 + bit / 8] ^= 1 << (bit % 8));
        frame.extend([0; MAX_TELEMETRY]);
        prop_assert_eq!(decode::<HostGrammar>(&frame).0, []);
    }

    #[test]
    fn one_wrong_bit_is_never_accepted_in_a_command(input in control_input(), bit in 0..17 * 8_usize) {
        let mut frame = input.frame().to_vec();
        frame[bit / 8] ^= 1 << (bit % 8);
        frame.extend([0; MAX_TELEMETRY]);
        prop_assert_eq!(decode::<VehicleGrammar>(&frame).0, []);
    }

    #[test]
    fn good_commands_are_found_in_noise((bytes, wanted) in stream(command())) {
        let (found, _) = decode::<VehicleGrammar>(&bytes);
        prop_assert!(in_order(&wanted, &found), "{wanted:?}\n{found:?}");
    }

    #[test]
    fn good_telemetry_is_found_in_noise((bytes, wanted) in stream(vehicle_frame())) {
        let (found, _) = decode::<HostGrammar>(&bytes);
        prop_assert!(in_order(&wanted, &found), "{wanted:?}\n{found:?}");
    }

    #[test]
    fn the_split_of_the_bytes_does_not_matter(
        (commands, _) in stream(command()),
        (telemetry, _) in stream(vehicle_frame()),
        pieces in prop::collection::vec(0..40_usize, 0..60),
    ) {
        let whole = decode::<VehicleGrammar>(&commands);
        prop_assert_eq!(whole, decode_in_pieces::<VehicleGrammar>(&commands, &pieces));
        let whole = decode::<HostGrammar>(&telemetry);
        prop_assert_eq!(whole, decode_in_pieces::<HostGrammar>(&telemetry, &pieces));
    }
}

#[test]
fn f20_every_wrong_bit_of_a_status_is_refused() {
    let frame = telemetry(Descriptor::LlStatus, &[0x5C; LlStatus::LEN]);
    for bit in 0..frame.len() * 8 {
        let mut damaged = frame.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        damaged.extend([0; MAX_TELEMETRY]);
        assert_eq!(decode::<HostGrammar>(&damaged).0, [], "bit {bit}");
    }
}

#[test]
fn f20_a_frame_cut_short_costs_only_itself() {
    let status = telemetry(Descriptor::LlStatus, &[1; LlStatus::LEN]);
    let wanted = HostEvent::LlStatus(LlStatus::parse(&[1; LlStatus::LEN]).unwrap());
    for cut in 1..status.len() {
        let stream = [&status[..cut], &status].concat();
        let (events, counters) = decode::<HostGrammar>(&stream);
        assert_eq!(events, [wanted], "cut to {cut}");
        assert_eq!(counters.skipped, cut as u64);
    }
}
