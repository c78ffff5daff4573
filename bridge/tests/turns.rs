//! Whole turns of the bridge before a line of finite speed, and before ports that take bytes in any pieces.

use crate::common::{
    FRAME, PERIOD, START, bridge, flight, header, over, serial, sizes, status, through_radio, turn,
};
use oqtal_bridge::{Bridge, LineOccupancy, MAX_FRAME, Note, VehicleFrame, VehicleTransport};
use oqtal_bus::code::{VehicleLink, VehicleRefusal};
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, VehicleDecoder, acknowledgement_frame,
};
use oqtal_wire::xbee::Framing;
use proptest::prelude::*;

/// Datagrams: unchanged frames, each sent at once.
#[derive(Debug)]
struct Datagrams;

impl VehicleTransport for Datagrams {
    fn max_frame(&self) -> usize {
        MAX_FRAME
    }

    fn overhead(&self) -> usize {
        0
    }

    fn byte_rate(&self) -> Option<f64> {
        None
    }

    fn wrap(&mut self, frame: &VehicleFrame) -> VehicleFrame {
        *frame
    }

    fn unwrap(&mut self, bytes: &[u8], payload: &mut dyn FnMut(&[u8])) {
        payload(bytes);
    }

    fn damaged(&self) -> u64 {
        0
    }

    fn reset(&mut self) {}
}

#[test]
fn datagrams_leave_at_once_and_status_is_requested_at_its_rate() {
    let mut bridge = over(Box::new(Datagrams));
    let (mut now, mut requests) = (START, 0);
    while now < START + Span::from_millis(10_000) {
        let (bytes, reported) = turn(&mut bridge, now);
        requests += usize::from(bytes.len() > 17);
        if let Some((_, _, vehicle)) = reported {
            assert_eq!((vehicle.wire_ns, bridge.ahead(now)), (0, Span::ZERO));
        }
        assert!(!bridge.is_stuck(now, 0));
        now = bridge.next_event(now).max(now + Span::from_millis(1));
    }
    // At most 8 per second, on a grid of 60.
    assert!((70..=80).contains(&requests), "{requests}");
}

proptest! {
    #[test]
    fn status_requests_never_delay_a_command_by_more_than_a_frame(
        framing in prop::sample::select(vec![Framing::Transparent, Framing::Api1, Framing::Api2]),
        jitter_us in prop::collection::vec(-6000..6000_i64, 100..300),
    ) {
        let mut bridge = through_radio(framing);
        // API mode 2 escapes a byte or two of a frame.
        let setpoint = sizes(framing).setpoint + if framing == Framing::Api2 { 4 } else { 0 };
        let line = LineOccupancy::new(serial(framing).byte_rate());
        let frame = line.time_for(setpoint);
        // In API mode, a status request that began just before an early command is ahead of it too.
        let request = line.time_for(sizes(framing).periodic);
        let ahead = if framing == Framing::Transparent { frame } else { frame + request };
        let (mut now, mut due, mut requests) = (START, START, 0);
        prop_assert!(ahead <= PERIOD, "at most a period");
        for (sequence, jitter_us) in (1..).zip(jitter_us) {
            due = due + PERIOD;
            let arrives = due + Span::from_nanos(jitter_us * 1000);
            // Frames by the bridge's own clock until then.
            while bridge.next_event(now) < arrives {
                now = bridge.next_event(now).max(now);
                let (bytes, _) = turn(&mut bridge, now);
                requests += usize::from(bytes.len() > setpoint);
                bridge.receive_bytes(now, &acknowledgement_frame(Descriptor::ControlInput), &mut |_| {});
            }
            now = arrives;
            bridge.receive_command(now, &header(sequence, now), CommandV1::default(), 0);
            let (stamps, vehicle) = loop {
                let (bytes, reported) = turn(&mut bridge, now);
                requests += usize::from(bytes.len() > setpoint);
                match reported {
                    Some((_, stamps, vehicle)) if stamps.applied_at.is_set() => break (stamps, vehicle),
                    _ => now = bridge.next_event(now),
                }
            };
            let took = now.since(arrives) + Span::from_nanos(vehicle.wire_ns);
            prop_assert!(took <= ahead + frame, "{took:?}");
            prop_assert_eq!(stamps.received_at, arrives);
        }
        prop_assert!(requests > 10, "{}", requests);
    }

    #[test]
    fn however_a_port_takes_bytes_only_whole_frames_reach_the_wire_unless_it_is_stuck(
        takes in prop::collection::vec(0..20_usize, 100..400),
    ) {
        let (mut bridge, mut now) = (bridge(), START);
        let mut wire = Vec::new();
        let mut discarded = false;
        for take in takes {
            now = bridge.next_event(now).max(now + Span::from_millis(1));
            if bridge.is_stuck(now, 0) {
                bridge.discard_outgoing();
                discarded = true;
            }
            bridge.turn(now, &mut |_| {});
            let count = take.min(bridge.outbox().len());
            wire.extend_from_slice(&bridge.outbox()[..count]);
            bridge.handed_over(now, count);
            bridge.follow_up(now);
        }
        let mut decoder = VehicleDecoder::new();
        let reply = decoder.push(&wire).count();
        prop_assert!(reply > 0 || discarded);
        if !discarded {
            prop_assert_eq!((decoder.counters().damaged, decoder.counters().skipped), (0, 0));
        }
    }

    #[test]
    fn any_bytes_may_come(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut bridge = bridge();
        bridge.receive_bytes(START, &bytes, &mut |_| {});
        let (_, reported) = turn(&mut bridge, START);
        prop_assert!(reported.is_some());
    }
}

#[test]
fn a_port_that_holds_bytes_back_for_longer_than_a_period_is_stuck() {
    let mut bridge = bridge();
    turn(&mut bridge, START);
    let soon = START + Span::from_millis(15);
    assert!(!bridge.is_stuck(soon, 17), "still within a period of its time");
    assert!(bridge.is_stuck(START + Span::from_millis(30), 17));
    assert!(!bridge.is_stuck(START + Span::from_millis(30), 0));
}

#[test]
fn bytes_that_a_port_keeps_although_they_were_discarded_are_waited_for() {
    let mut bridge = bridge();
    assert!(!bridge.is_stuck(START, 100), "left over from another process");
    assert!(turn(&mut bridge, START).0.is_empty());
    assert!(bridge.is_stuck(START + Span::from_millis(17), 100));
    bridge.discard_outgoing();
    assert!(!bridge.is_stuck(START + Span::from_millis(18), 100));
    assert!(turn(&mut bridge, START + Span::from_millis(18)).0.is_empty());
    assert!(!bridge.is_stuck(START + Span::from_millis(19), 0));
    assert_eq!(
        turn(&mut bridge, START + Span::from_millis(19)).0[..17],
        ControlInput::ZERO_SETPOINT.frame()
    );
}

#[test]
fn motors_without_a_status_count_as_running_while_the_vehicle_answers() {
    let mut bridge = bridge();
    bridge.receive_bytes(START, &status(1), &mut |_| {});
    let mut armed = |millis: i64, acknowledged: bool| {
        let now = START + Span::from_millis(millis);
        if acknowledged {
            bridge.receive_bytes(
                now,
                &acknowledgement_frame(Descriptor::ControlInput),
                &mut |_| {},
            );
        }
        bridge.report(now, None, Span::ZERO).2.armed
    };
    assert!((1..=60).all(|step| armed(500 * step, true) == 1));
    assert_eq!((armed(31_000, false), armed(31_001, false)), (1, 0), "silent for a second");
    bridge.receive_bytes(START + Span::from_millis(32_000), &status(0), &mut |_| {});
    assert_eq!(bridge.report(START + Span::from_millis(32_000), None, Span::ZERO).2.armed, 0);
}

/// Acknowledgements say nothing of the motors, and another host may start them.
#[test]
fn motors_are_known_to_be_off_for_a_second_after_a_status() {
    let mut bridge = bridge();
    let mut link = |millis: i64, has_status: bool| {
        let now = START + Span::from_millis(millis);
        let answer = acknowledgement_frame(Descriptor::ControlInput);
        bridge.receive_bytes(now, &answer, &mut |_| {});
        if has_status {
            bridge.receive_bytes(now, &status(0), &mut |_| {});
        }
        turn(&mut bridge, now);
        let vehicle = bridge.report(now, None, Span::ZERO).2;
        (VehicleLink::from_code(vehicle.link), VehicleRefusal::from_code(vehicle.refusal))
    };
    let known = (Some(VehicleLink::Answers), Some(VehicleRefusal::None));
    let unknown = (Some(VehicleLink::MotorsUnknown), Some(VehicleRefusal::NotSetUp));
    link(0, false);
    assert_eq!([link(100, false), link(200, true)], [unknown, known]);
    assert_eq!([link(1200, false), link(1201, false)], [known, unknown]);
    assert_eq!(link(1300, true), known);
}

#[test]
fn the_first_of_each_run_of_rejected_commands_is_noted() {
    let mut bridge = bridge();
    let mut notes = 0;
    for run in [0, 10_000] {
        for frame in 0..100 {
            let now = START + Span::from_millis(run + 17 * frame);
            let old = now - Span::from_millis(60);
            bridge.receive_command(now, &header(1, old), flight(), 0);
            bridge.turn(now, &mut |note| notes += u32::from(note == Note::CommandRejected));
        }
    }
    assert_eq!(notes, 2);
}

/// Port whose far end pauses it by flow control: bytes that it has taken and not sent, and those sent, with their instants.
#[derive(Default)]
struct PausingPort {
    queue: std::collections::VecDeque<u8>,
    sent: Vec<(Time, u8)>,
}

impl PausingPort {
    fn send_until(&mut self, from: Time, until: Time) {
        let byte = FRAME.scaled(1.0 / 17.0);
        let mut at = from + byte;
        while at <= until && !self.queue.is_empty() {
            self.sent.extend(self.queue.pop_front().map(|byte| (at, byte)));
            at = at + byte;
        }
    }
}

/// A command whose stick encodes its sequence; the first nine are "disarmed".
fn numbered(sequence: usize) -> CommandV1 {
    let stick = sequence as f64 / 2047.0;
    let command = CommandV1 { sticks: [stick, 0.0, 0.0], ..flight() };
    if sequence < 10 { CommandV1::default() } else { command }
}

/// Flies with a command every period through a port with `pauses` (begin, length) \[ms\]; returns the age on the wire of each
/// flight command.
fn ages_through(pauses: &[(i64, i64)]) -> Vec<Span> {
    let (mut bridge, mut port) = (bridge(), PausingPort::default());
    let (mut now, mut due, mut published) = (START, START, Vec::new());
    let paused = |now: Time| {
        let millis = now.since(START).nanos() / 1_000_000;
        pauses.iter().any(|(begin, length)| (*begin..begin + length).contains(&millis))
    };
    while now < START + Span::from_millis(4000) {
        if now >= due {
            due = due + PERIOD;
            published.push(now);
            let sequence = published.len();
            bridge.receive_bytes(now, &status(1), &mut |_| {});
            bridge.receive_command(now, &header(sequence as u64, now), numbered(sequence), 0);
        }
        if bridge.is_stuck(now, port.queue.len()) {
            port.queue.clear();
            bridge.discard_outgoing();
        }
        port.queue.extend(turn(&mut bridge, now).0);
        let next = now + Span::from_millis(1);
        if !paused(now) {
            port.send_until(now, next);
        }
        now = next;
    }
    ages(&port.sent, &published)
}

/// Age of each flight command among the bytes `sent`, by its instant of publication.
fn ages(sent: &[(Time, u8)], published: &[Time]) -> Vec<Span> {
    let mut decoder = VehicleDecoder::new();
    let mut ages = Vec::new();
    for (at, byte) in sent {
        for command in decoder.push(&[*byte]) {
            let HostCommand::Control(input) = command else { continue };
            if input.thrust > 0 {
                ages.push(at.since(published[usize::from(input.roll.unsigned_abs()) - 1]));
            }
        }
    }
    ages
}

proptest! {
    #[test]
    fn no_command_waits_in_a_port_that_pauses_while_sixty_a_second_come(
        pauses in prop::collection::vec((300..3500_i64, 1..1500_i64), 0..4),
    ) {
        let ages = ages_through(&pauses);
        prop_assert!(!ages.is_empty());
        // A frame held back with less than half of it to go is detected with the next one, and discarded a period later.
        let oldest = PERIOD.scaled(2.0) + FRAME.scaled(3.0) + Span::from_millis(2);
        for age in ages {
            prop_assert!(age <= oldest, "{age:?}");
        }
    }
}

#[test]
fn a_vehicle_whose_motors_do_not_stop_gets_the_emergency_stop_once() {
    let mut bridge = bridge();
    let (mut now, mut sequence, mut stops) = (START, 0, 0);
    let mut step = |bridge: &mut Bridge, command: CommandV1, motors_on: i8| {
        now = now + PERIOD;
        sequence += 1;
        bridge.receive_bytes(now, &status(motors_on), &mut |_| {});
        bridge.receive_command(now, &header(sequence, now), command, 0);
        let (bytes, _) = turn(bridge, now);
        let reply: Vec<HostCommand> = VehicleDecoder::new().push(&bytes).collect();
        stops += reply.iter().filter(|command| **command == HostCommand::EmergencyStop).count();
        reply
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
    assert_eq!(last[0], HostCommand::Control(ControlInput::ZERO_SETPOINT));
    assert_eq!(stops, 1);
}
