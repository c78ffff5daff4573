//! Whole turns of the bridge over a serial line that takes its time, and ports that take bytes as they like.

use oqtal_bridge::{Asctec, Bridge, Note};
use oqtal_bus::code::Actuation;
use oqtal_bus::config::Config;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_wire::asctec::{
    Command, ControlInput, Descriptor, LlStatus, VehicleDecoder, acknowledgement_frame,
    write_telemetry,
};
use proptest::prelude::*;

const BAUD: u32 = 57_600;
const START: Time = Time::VIRTUAL_START;
/// 17 bytes of ten bits at 57600 baud.
const FRAME: Span = Span::from_nanos(2_951_389);

fn bridge() -> Bridge {
    let config = Config::default();
    let mut bridge = Bridge::new(&config, Box::new(Asctec::new(&config)), BAUD, START);
    bridge.open(START);
    bridge
}

fn header(sequence: u64, at: Time) -> Header {
    let stamps = Stamps { command_published_at: at, ..Stamps::default() };
    Header { sequence, pose_sequence: sequence, stamps, ..Header::default() }
}

fn flight() -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [0.1; 3], thrust: 0.3, ..CommandV1::default() }
}

/// A turn with a port that takes everything; the bytes of order and poll, and what was reported.
fn turn(bridge: &mut Bridge, now: Time) -> (Vec<u8>, Option<oqtal_bridge::Report>) {
    let (mut bytes, mut reported) = (Vec::new(), None);
    let mut all = |bridge: &mut Bridge| {
        let count = bridge.outbox().len();
        bytes.extend_from_slice(bridge.outbox());
        if count > 0 {
            reported = bridge.handed_over(now, count).or(reported);
        }
    };
    all(bridge);
    bridge.turn(now, &mut |_: Note| {});
    if !bridge.outbox().is_empty() {
        all(bridge);
        bridge.follow_up(now);
        all(bridge);
    }
    (bytes, reported)
}

fn status(motors_on: i8) -> Vec<u8> {
    let mut frame = [0; 103];
    let payload = LlStatus { battery_1_mv: 11_100, motors_on, ..LlStatus::default() }.payload();
    let length = write_telemetry(Descriptor::LlStatus, &payload, &mut frame).unwrap();
    frame[..length].to_vec()
}

proptest! {
    #[test]
    fn polling_never_delays_a_command_by_more_than_a_frame(
        jitter_us in prop::collection::vec(-6000..6000_i64, 100..300),
    ) {
        let mut bridge = bridge();
        let (mut now, mut due) = (START, START);
        let mut polls = 0;
        for (sequence, jitter_us) in (1..).zip(jitter_us) {
            due = due + Span::from_nanos(16_666_667);
            let arrives = due + Span::from_nanos(jitter_us * 1000);
            // The bridge's own frames until then.
            while bridge.next_event(now) < arrives {
                now = bridge.next_event(now).max(now);
                let (bytes, _) = turn(&mut bridge, now);
                polls += usize::from(bytes.len() > 17);
                bridge.hear(now, &acknowledgement_frame(Descriptor::ControlInput));
            }
            now = arrives;
            bridge.receive(now, &header(sequence, now), CommandV1::default(), 0);
            let mut applied = None;
            while applied.is_none() {
                let (bytes, reported) = turn(&mut bridge, now);
                polls += usize::from(bytes.len() > 17);
                applied = reported.filter(|(_, stamps, _)| stamps.applied_at.is_set());
                now = if applied.is_none() { bridge.next_event(now) } else { now };
            }
            let (_, stamps, vehicle) = applied.unwrap();
            let took = now.since(arrives) + Span::from_nanos(vehicle.wire_ns);
            prop_assert!(took <= FRAME + FRAME, "{took:?}");
            prop_assert_eq!(stamps.received_at, arrives);
        }
        prop_assert!(polls > 10, "{}", polls);
    }

    #[test]
    fn however_a_port_takes_bytes_only_whole_frames_reach_the_wire_unless_it_is_stuck(
        takes in prop::collection::vec(0..20_usize, 100..400),
    ) {
        let (mut bridge, mut now) = (bridge(), START);
        let mut wire = Vec::new();
        let mut dropped = false;
        for take in takes {
            now = bridge.next_event(now).max(now + Span::from_millis(1));
            if bridge.is_stuck(now, 0) {
                bridge.drop_outgoing();
                dropped = true;
            }
            bridge.turn(now, &mut |_| {});
            let count = take.min(bridge.outbox().len());
            wire.extend_from_slice(&bridge.outbox()[..count]);
            bridge.handed_over(now, count);
            bridge.follow_up(now);
        }
        let mut decoder = VehicleDecoder::new();
        let heard = decoder.push(&wire).count();
        prop_assert!(heard > 0 || dropped);
        if !dropped {
            prop_assert_eq!((decoder.counters().damaged, decoder.counters().skipped), (0, 0));
        }
    }

    #[test]
    fn any_bytes_may_come(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut bridge = bridge();
        bridge.hear(START, &bytes);
        let (_, reported) = turn(&mut bridge, START);
        prop_assert!(reported.is_some());
    }
}

#[test]
fn a_port_that_holds_bytes_back_is_found_out_and_what_it_holds_is_old() {
    let mut bridge = bridge();
    turn(&mut bridge, START);
    let soon = START + Span::from_millis(15);
    assert!(!bridge.is_stuck(soon, 17), "still within a period of its time");
    assert!(bridge.is_stuck(START + Span::from_millis(30), 17));
    assert!(!bridge.is_stuck(START + Span::from_millis(30), 0));
}

#[test]
fn a_vehicle_whose_motors_do_not_stop_gets_the_emergency_stop_once() {
    let mut bridge = bridge();
    let (mut now, mut sequence, mut stops) = (START, 0, 0);
    let mut step = |bridge: &mut Bridge, command: CommandV1, motors_on: i8| {
        now = now + Span::from_nanos(16_666_667);
        sequence += 1;
        bridge.hear(now, &status(motors_on));
        bridge.receive(now, &header(sequence, now), command, 0);
        let (bytes, _) = turn(bridge, now);
        let heard: Vec<Command> = VehicleDecoder::new().push(&bytes).collect();
        stops += heard.iter().filter(|command| **command == Command::EmergencyStop).count();
        heard
    };
    for _ in 0..10 {
        step(&mut bridge, CommandV1::default(), 0);
    }
    step(&mut bridge, flight(), 0);
    step(&mut bridge, flight(), 1);
    for _ in 0..1000 {
        step(&mut bridge, CommandV1::default(), 1);
    }
    let last = step(&mut bridge, CommandV1::default(), 1);
    assert_eq!(last[0], Command::Control(ControlInput::NEUTRAL));
    assert_eq!(stops, 1);
}
