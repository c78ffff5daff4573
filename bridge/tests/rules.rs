//! The bridge's own rules, the same for every language that it speaks: nothing old is sent, nothing before the vehicle was at rest
//! after a port was opened, nothing at all while another has control; every command forwarded has its stamps.

#[path = "rules/asctec.rs"]
mod asctec;
#[path = "rules/mavlink.rs"]
mod mavlink;
#[path = "rules/peer.rs"]
mod peer;

use std::collections::BTreeMap;

use asctec::AsctecPeer;
use mavlink::MavlinkPeer;
use oqtal_bridge::{Bridge, Note, VehicleReport};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::MAX_PACKET;
use peer::{Heard, LanguagePeer};
use proptest::prelude::*;

const START: Time = Time::VIRTUAL_START;
/// Three control periods: `bridge.command-timeout-periods` of the shipped configuration.
const COMMAND_AGE: Span = Span::from_nanos(50_000_001);
/// Commands that are told apart by their thrust \[-\].
const COMMANDS: u64 = 200;

/// The vehicles at the other end, one for each language and kind.
fn peers() -> Vec<Box<dyn LanguagePeer>> {
    vec![
        Box::new(AsctecPeer::new()),
        Box::new(MavlinkPeer::new(AutopilotKind::ArduPilot)),
        Box::new(MavlinkPeer::new(AutopilotKind::Px4)),
    ]
}

/// Something that happens.
#[derive(Clone, Debug)]
enum Happening {
    /// A command arrives that was published so long ago \[us\]; negative for the future.
    Command { flies: bool, age_us: i64 },
    /// A pose arrives that was published so long ago \[us\].
    Pose { age_us: i64 },
    /// The vehicle tells its motors, and whether a pilot flies.
    Status { running: bool, piloted: bool },
    /// Bytes of nobody arrive.
    Noise(Vec<u8>),
    /// The port is lost and opened again.
    Reopened,
    /// Time passes.
    Turn,
}

fn happening() -> impl Strategy<Value = Happening> {
    let age = || prop_oneof![5 => 0..2000_i64, 1 => 0..200_000_i64, 1 => -50_000..0_i64];
    prop_oneof![
        6 => (any::<bool>(), age()).prop_map(|(flies, age_us)| Happening::Command { flies: flies || age_us % 3 > 0, age_us }),
        2 => age().prop_map(|age_us| Happening::Pose { age_us }),
        4 => (any::<bool>(), 0..8_u8).prop_map(|(running, pilot)| Happening::Status { running, piloted: pilot == 0 }),
        1 => prop::collection::vec(any::<u8>(), 0..80).prop_map(Happening::Noise),
        1 => Just(Happening::Reopened),
        8 => Just(Happening::Turn),
    ]
}

fn happenings() -> impl Strategy<Value = Vec<(i64, Happening)>> {
    let pause = prop_oneof![8 => 0..20_000_i64, 1 => 0..400_000_i64];
    prop::collection::vec((pause, happening()), 1..250)
}

/// A bridge, the vehicle at its other end, and what is known of both.
struct Exchange {
    bridge: Bridge,
    peer: Box<dyn LanguagePeer>,
    now: Time,
    sequence: u64,
    /// Publication of each flight command by its number.
    published: BTreeMap<u64, Time>,
    poses: BTreeMap<u64, Time>,
    /// No set-point was sent since the port was opened.
    is_first: bool,
    /// Instant of the last command that asked for a flight, accepted or not, since the port was opened.
    piloted: bool,
}

impl Exchange {
    fn new(mut peer: Box<dyn LanguagePeer>) -> Self {
        let config = Config::default();
        let (protocol, transport) = peer.ends(&config);
        let mut bridge = Bridge::new(&config, protocol, transport, START);
        bridge.open(START);
        peer.reset();
        Self {
            bridge,
            peer,
            now: START,
            sequence: 0,
            published: BTreeMap::new(),
            poses: BTreeMap::new(),
            is_first: true,
            piloted: false,
        }
    }

    /// Thrust of the command `number`: each has its own.
    fn thrust(number: u64) -> f64 {
        0.1 + 0.8 * (number % COMMANDS) as f64 / COMMANDS as f64
    }

    fn happens(&mut self, happening: Happening) -> Result<(), TestCaseError> {
        let now = self.now;
        match happening {
            Happening::Command { flies, age_us } => self.command(flies, age_us),
            Happening::Pose { age_us } => {
                let published = now - Span::from_nanos(age_us * 1000);
                let captured_at = published - Span::from_millis(15);
                let stamps =
                    Stamps { captured_at, pose_published_at: published, ..Stamps::default() };
                let pose =
                    PoseV1 { attitude: [0.0, 0.0, 0.0, 1.0], tracked: 1, ..PoseV1::default() };
                self.bridge.receive_pose(&Header { stamps, ..Header::default() }, &pose);
                self.poses.insert(captured_at.nanos() / 1000, published);
            }
            Happening::Status { running, piloted } => {
                self.piloted = running && piloted && self.peer.tells_control();
                let bytes = self.peer.status(running, self.piloted);
                self.bridge.receive_bytes(now, &bytes, &mut |_: Note| {});
            }
            Happening::Noise(bytes) => {
                // A false beginning takes what follows for its packet: the quiet that ends the longest one follows at once, so that
                // the vehicle's next word is heard.
                let noise = [&bytes[..], &[0; MAX_PACKET]].concat();
                self.bridge.receive_bytes(now, &noise, &mut |_| {});
            }
            Happening::Reopened => {
                self.bridge.close(now);
                self.bridge.open(now);
                self.peer.reset();
                (self.is_first, self.piloted) = (true, false);
            }
            Happening::Turn => {}
        }
        self.turn()
    }

    fn command(&mut self, flies: bool, age_us: i64) {
        self.sequence += 1;
        let published = self.now - Span::from_nanos(age_us * 1000);
        let stamps = Stamps { command_published_at: published, ..Stamps::default() };
        let header = Header { sequence: self.sequence, stamps, ..Header::default() };
        let flight = CommandV1 {
            actuation: Actuation::Sticks.code(),
            thrust: Self::thrust(self.sequence),
            ..CommandV1::default()
        };
        let command = if flies { flight } else { CommandV1::default() };
        if flies {
            self.published.insert(self.sequence % COMMANDS, published);
        }
        self.bridge.receive_command(self.now, &header, command, 0);
    }

    /// One turn with a port that takes everything.
    fn turn(&mut self) -> Result<(), TestCaseError> {
        let unsent = self.bridge.turn(self.now, &mut |_: Note| {});
        self.check_report(unsent)?;
        self.write()?;
        let mut words = 0;
        while self.bridge.follow_up(self.now) {
            self.write()?;
            words += 1;
            prop_assert!(words <= 8, "frames without end");
        }
        Ok(())
    }

    fn write(&mut self) -> Result<(), TestCaseError> {
        let bytes = self.bridge.outbox().to_vec();
        if bytes.is_empty() {
            return Ok(());
        }
        let report = self.bridge.handed_over(self.now, bytes.len());
        self.check_report(report)?;
        for heard in self.peer.hears(&bytes) {
            self.check(heard)?;
        }
        Ok(())
    }

    fn check(&mut self, heard: Heard) -> Result<(), TestCaseError> {
        let name = self.peer.name();
        let is_setpoint = !matches!(heard, Heard::Word | Heard::Pose { .. });
        if is_setpoint {
            prop_assert!(!self.piloted, "{name}: {heard:?} while a pilot flies");
            let is_quiet = heard == Heard::Zero;
            prop_assert!(!self.is_first || is_quiet, "{name}: {heard:?} first");
            self.is_first = false;
        }
        match heard {
            Heard::Flight { thrust } => {
                let near = |number: &&u64| (Self::thrust(**number) - thrust).abs() < 1e-3;
                let number = self.published.keys().find(near);
                prop_assert!(number.is_some(), "{name}: {thrust} was not commanded");
                let at = self.published[number.unwrap()];
                prop_assert!(at <= self.now && self.now.since(at) <= COMMAND_AGE, "{name}: old");
            }
            Heard::Pose { captured_us: Some(captured) } => {
                let published = self.poses.get(&captured);
                prop_assert!(published.is_some(), "{name}: a pose of another time");
                prop_assert!(
                    self.now.since(*published.unwrap()) <= COMMAND_AGE,
                    "{name}: old pose"
                );
            }
            _ => {}
        }
        Ok(())
    }

    fn check_report(&self, report: Option<VehicleReport>) -> Result<(), TestCaseError> {
        let Some((_, stamps, vehicle)) = report else { return Ok(()) };
        if stamps.applied_at.is_set() {
            prop_assert!(stamps.received_at <= stamps.applied_at);
            prop_assert!(stamps.command_published_at <= stamps.received_at);
            prop_assert!(stamps.applied_at.since(stamps.command_published_at) <= COMMAND_AGE);
            prop_assert!(vehicle.command_sequence > 0);
        }
        Ok(())
    }
}

proptest! {
    #[test]
    fn the_rules_hold_in_every_language(happenings in happenings()) {
        for peer in peers() {
            let mut exchange = Exchange::new(peer);
            for (pause_us, happening) in &happenings {
                exchange.now = exchange.now + Span::from_nanos(pause_us * 1000);
                exchange.happens(happening.clone())?;
            }
        }
    }
}

/// A flight in every language: rest, start, flight, end, stop.
#[test]
fn every_language_starts_flies_and_stops() {
    for peer in peers() {
        let mut exchange = Exchange::new(peer);
        let name = exchange.peer.name();
        let (mut running, mut flown, mut stopped) = (false, 0, false);
        for period in 0..840 {
            exchange.now = exchange.now + Span::from_nanos(16_666_667);
            let status = exchange.peer.status(running, false);
            exchange.bridge.receive_bytes(exchange.now, &status, &mut |_: Note| {});
            exchange.command((200..520).contains(&period), 0);
            let unsent = exchange.bridge.turn(exchange.now, &mut |_: Note| {});
            assert!(unsent.is_none() || period == 0, "{name}: period {period}");
            while !exchange.bridge.outbox().is_empty() {
                let bytes = exchange.bridge.outbox().to_vec();
                exchange.bridge.handed_over(exchange.now, bytes.len());
                for heard in exchange.peer.hears(&bytes) {
                    match heard {
                        Heard::Start => running = true,
                        Heard::Stop => (running, stopped) = (false, running),
                        Heard::Toggle => (running, stopped) = (!running, running || stopped),
                        Heard::Flight { .. } => flown += 1,
                        _ => {}
                    }
                }
                exchange.bridge.follow_up(exchange.now);
            }
        }
        assert!(flown > 150 && stopped && !running, "{name}: {flown} flown, {stopped}, {running}");
    }
}
