//! Whole turns of the bridge over a serial line that takes its time, and ports that take bytes as they like.

use oqtal_bridge::{Asctec, Bridge, LineOccupancy, Note, VehicleProtocol, through};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, LlStatus, VehicleDecoder, acknowledgement_frame,
    write_telemetry,
};
use oqtal_wire::xbee::{Address, Framing};
use proptest::prelude::*;

const BAUD: u32 = 57_600;
const START: Time = Time::VIRTUAL_START;
/// 17 bytes of ten bits at 57600 baud.
const FRAME: Span = Span::from_nanos(2_951_389);

fn bridge() -> Bridge {
    through_radio(Framing::Transparent)
}

fn protocol(framing: Framing) -> Box<dyn VehicleProtocol> {
    through(framing, Address::BROADCAST, Box::new(Asctec::new(&Config::default()).unwrap()))
}

fn through_radio(framing: Framing) -> Bridge {
    let mut bridge = Bridge::new(&Config::default(), protocol(framing), BAUD, START);
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

/// A turn with a port that takes everything; the bytes of setpoint and poll, and what was reported.
fn turn(bridge: &mut Bridge, now: Time) -> (Vec<u8>, Option<oqtal_bridge::VehicleReport>) {
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
        framing in prop::sample::select(vec![Framing::Transparent, Framing::Api1, Framing::Api2]),
        jitter_us in prop::collection::vec(-6000..6000_i64, 100..300),
    ) {
        let mut bridge = through_radio(framing);
        // API 2 escapes a byte or two of a frame.
        let escapes = if framing == Framing::Api2 { 4 } else { 0 };
        let setpoint = protocol(framing).sizes().setpoint + escapes;
        let frame = LineOccupancy::new(BAUD).time_for(setpoint);
        // Through a radio's frames, a poll that a command came upon early is ahead of it too.
        let poll = LineOccupancy::new(BAUD).time_for(protocol(framing).sizes().poll);
        let ahead = if framing == Framing::Transparent { frame } else { frame + poll };
        prop_assert!(ahead <= Span::from_nanos(16_666_667), "at most a period");
        let (mut now, mut due) = (START, START);
        let mut polls = 0;
        for (sequence, jitter_us) in (1..).zip(jitter_us) {
            due = due + Span::from_nanos(16_666_667);
            let arrives = due + Span::from_nanos(jitter_us * 1000);
            // The bridge's own frames until then.
            while bridge.next_event(now) < arrives {
                now = bridge.next_event(now).max(now);
                let (bytes, _) = turn(&mut bridge, now);
                polls += usize::from(bytes.len() > setpoint);
                bridge.hear(now, &acknowledgement_frame(Descriptor::ControlInput));
            }
            now = arrives;
            bridge.receive(now, &header(sequence, now), CommandV1::default(), 0);
            let mut applied = None;
            while applied.is_none() {
                let (bytes, reported) = turn(&mut bridge, now);
                polls += usize::from(bytes.len() > setpoint);
                applied = reported.filter(|(_, stamps, _)| stamps.applied_at.is_set());
                now = if applied.is_none() { bridge.next_event(now) } else { now };
            }
            let (_, stamps, vehicle) = applied.unwrap();
            let took = now.since(arrives) + Span::from_nanos(vehicle.wire_ns);
            prop_assert!(took <= ahead + frame, "{took:?}");
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
        let reply = decoder.push(&wire).count();
        prop_assert!(reply > 0 || dropped);
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
fn what_a_port_keeps_although_it_was_dropped_is_waited_for() {
    let mut bridge = bridge();
    assert!(!bridge.is_stuck(START, 100), "left over from somebody else");
    assert!(turn(&mut bridge, START).0.is_empty());
    assert!(bridge.is_stuck(START + Span::from_millis(17), 100));
    bridge.drop_outgoing();
    assert!(!bridge.is_stuck(START + Span::from_millis(18), 100));
    assert!(turn(&mut bridge, START + Span::from_millis(18)).0.is_empty());
    assert!(!bridge.is_stuck(START + Span::from_millis(19), 0));
    assert_eq!(
        turn(&mut bridge, START + Span::from_millis(19)).0[..17],
        ControlInput::ZERO_SETPOINT.frame()
    );
}

#[test]
fn motors_of_which_no_word_survives_run_on_while_the_vehicle_answers_at_all() {
    let mut bridge = bridge();
    bridge.hear(START, &status(1));
    let mut armed = |millis: i64, acknowledged: bool| {
        let now = START + Span::from_millis(millis);
        if acknowledged {
            bridge.hear(now, &acknowledgement_frame(Descriptor::ControlInput));
        }
        bridge.report(now, None, Span::ZERO).2.armed
    };
    assert!((1..=60).all(|step| armed(500 * step, true) == 1));
    assert_eq!((armed(31_000, false), armed(31_001, false)), (1, 0), "silent for a second");
    bridge.hear(START + Span::from_millis(32_000), &status(0));
    assert_eq!(bridge.report(START + Span::from_millis(32_000), None, Span::ZERO).2.armed, 0);
}

#[test]
fn of_refused_commands_the_first_of_each_run_is_noted() {
    let mut bridge = bridge();
    let mut notes = 0;
    for run in [0, 10_000] {
        for frame in 0..100 {
            let now = START + Span::from_millis(run + 17 * frame);
            let old = now - Span::from_millis(60);
            bridge.receive(now, &header(1, old), flight(), 0);
            bridge.turn(now, &mut |note| notes += u32::from(note == Note::RefusedOld));
        }
    }
    assert_eq!(notes, 2);
}

/// A port whose far end now and then asks for a pause: what it has taken and not sent, by when it goes if nothing holds it up.
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

/// Flies with a command every period through a port that pauses from time to time: age of each flight setpoint on the wire.
fn ages_through(pauses: &[(i64, i64)]) -> Vec<Span> {
    let (mut bridge, mut port) = (bridge(), PausingPort::default());
    let period = Span::from_nanos(16_666_667);
    let mut published = Vec::new();
    let mut now = START;
    let mut due = START;
    let paused = |now: Time| {
        let millis = now.since(START).nanos() / 1_000_000;
        pauses.iter().any(|(begin, length)| (*begin..begin + length).contains(&millis))
    };
    while now < START + Span::from_millis(4000) {
        if now >= due {
            due = due + period;
            published.push(now);
            let sequence = published.len();
            // Its number is in its sticks.
            let stick = sequence as f64 / 2047.0;
            let command = CommandV1 { sticks: [stick, 0.0, 0.0], ..flight() };
            let command = if sequence < 10 { CommandV1::default() } else { command };
            bridge.hear(now, &status(1));
            bridge.receive(now, &header(sequence as u64, now), command, 0);
        }
        if bridge.is_stuck(now, port.queue.len()) {
            port.queue.clear();
            bridge.drop_outgoing();
        }
        port.queue.extend(turn(&mut bridge, now).0);
        let next = now + Span::from_millis(1);
        if !paused(now) {
            port.send_until(now, next);
        }
        now = next;
    }
    let mut decoder = VehicleDecoder::new();
    let mut ages = Vec::new();
    for (at, byte) in &port.sent {
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
        // Held back with less than half a frame to go, it is found out with the next one, and dropped a period after that.
        let oldest = Span::from_nanos(2 * 16_666_667) + FRAME.scaled(3.0) + Span::from_millis(2);
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
        now = now + Span::from_nanos(16_666_667);
        sequence += 1;
        bridge.hear(now, &status(motors_on));
        bridge.receive(now, &header(sequence, now), command, 0);
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
