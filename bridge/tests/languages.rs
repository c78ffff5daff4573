//! The bridge's own rules, over a list of languages: whatever commands arrive and however the port fails, nothing old is ever sent,
//! the vehicle gets zero set-points soon after the last command, and a flight is not resumed after a loss.

#[path = "languages/asctec.rs"]
mod asctec;
#[path = "languages/crtp.rs"]
mod crtp;
#[path = "languages/language.rs"]
mod language;

use language::{Language, LanguageVehicle, Understood};
use oqtal_bridge::{Bridge, Note};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};
use proptest::prelude::*;

const PERIOD: Span = Span::from_nanos(16_666_667);
/// `bridge.command-timeout-periods` as shipped.
const COMMAND_AGE: Span = Span::from_millis(50);
/// Steps of a stick that every language tells apart \[1/s\].
const STICK_STEPS: f64 = 2047.0;

/// All languages. A further one is a row.
const LANGUAGES: [Language; 2] = [asctec::LANGUAGE, crtp::LANGUAGE];

/// What happens in one period.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Happening {
    Flight,
    Old,
    Future,
    Disarmed,
    Nothing,
    PortLost,
}

/// Set-point that was sent, and when.
#[derive(Clone, Copy, Debug)]
struct SentSetpoint {
    at: Time,
    what: Understood,
}

/// Bridge and vehicle of one language.
struct Flight {
    bridge: Bridge,
    vehicle: Box<dyn LanguageVehicle>,
    now: Time,
    commands: u64,
    /// Publication of each command, by its sequence.
    published: Vec<Time>,
    sent: Vec<SentSetpoint>,
    stamps: Vec<Stamps>,
}

impl Flight {
    fn new(language: &Language) -> Self {
        let now = Time::VIRTUAL_START;
        let mut bridge = (language.bridge)(now);
        bridge.open(now);
        let vehicle = (language.vehicle)();
        let (sent, stamps, published) = (Vec::new(), Vec::new(), vec![Time::UNSET]);
        Self { bridge, vehicle, now, commands: 0, published, sent, stamps }
    }

    fn command(&mut self, age: Span, is_flight: bool) {
        self.commands += 1;
        let published_at = self.now - age;
        self.published.push(published_at);
        let stamps = Stamps { command_published_at: published_at, ..Stamps::default() };
        let header = Header { sequence: self.commands, stamps, ..Header::default() };
        let stick = (self.commands % 1000 + 1) as f64 / STICK_STEPS;
        let actuation = Actuation::Sticks.code();
        let flight =
            CommandV1 { actuation, sticks: [stick, 0.0, 0.0], thrust: 0.3, ..CommandV1::default() };
        let command = if is_flight { flight } else { CommandV1::default() };
        self.bridge.receive_command(self.now, &header, command, 0);
    }

    fn happen(&mut self, happening: Happening) {
        match happening {
            Happening::Flight => self.command(Span::from_millis(1), true),
            Happening::Old => self.command(COMMAND_AGE + Span::from_millis(1), true),
            Happening::Future => self.command(Span::from_millis(-5), true),
            Happening::Disarmed => self.command(Span::from_millis(1), false),
            Happening::Nothing => {}
            Happening::PortLost => {
                self.bridge.close(self.now);
                self.bridge.open(self.now);
            }
        }
        self.pass_period();
    }

    /// Lets a period pass in milliseconds.
    fn pass_period(&mut self) {
        let end = self.now + PERIOD;
        while self.now < end {
            let mut answers = Vec::new();
            self.vehicle.tick(self.now, &mut answers);
            self.hear(&mut answers);
            if self.bridge.next_event(self.now) <= self.now {
                self.bridge.begin_read(self.now);
                self.bridge.turn(self.now, &mut |_: Note| {});
                self.send(&mut answers);
                while self.bridge.follow_up(self.now) {
                    self.send(&mut answers);
                }
                self.hear(&mut answers);
            }
            self.now = self.now + Span::from_millis(1).min(end.since(self.now));
        }
    }

    fn send(&mut self, answers: &mut Vec<Vec<u8>>) {
        let frame = self.bridge.outbox().to_vec();
        if frame.is_empty() {
            return;
        }
        if let Some(what) = self.vehicle.take(self.now, &frame, answers) {
            self.sent.push(SentSetpoint { at: self.now, what });
        }
        let report = self.bridge.handed_over(self.now, frame.len());
        self.stamps.extend(report.map(|(_, stamps, _)| stamps).filter(|s| s.applied_at.is_set()));
    }

    fn hear(&mut self, answers: &mut Vec<Vec<u8>>) {
        for answer in answers.drain(..) {
            self.bridge.receive_bytes(self.now, &answer, &mut |_| {});
        }
    }

    /// Flight set-points since the beginning \[-\].
    fn flights(&self) -> usize {
        self.sent.iter().filter(|sent| sent.what != Understood::NoThrust).count()
    }

    /// Lets the vehicle be set up and flown, by commands in every period.
    fn until_airborne(&mut self, name: &str) {
        (0..600).for_each(|_| self.happen(Happening::Disarmed));
        let before = self.flights();
        for _ in 0..600 {
            self.happen(Happening::Flight);
            if self.flights() > before {
                return;
            }
        }
        panic!("{name}: the vehicle does not fly: {:?}", self.sent.last());
    }

    /// Checks that every flight set-point carries a command that was young when it went, and that hops are in order.
    fn check(&self, name: &str) -> Result<(), TestCaseError> {
        for sent in &self.sent {
            let Understood::Flight(stick) = sent.what else { continue };
            let number = (stick * STICK_STEPS).round() as u64;
            let is_it = |sequence: &u64| (sequence % 1000 + 1) == number;
            let newest = (1..=self.commands).rev().filter(is_it).find(|sequence| {
                let age = sent.at.since(self.published[*sequence as usize]);
                age >= Span::ZERO && age <= COMMAND_AGE
            });
            prop_assert!(newest.is_some(), "{}: {:?} is of no young command", name, sent);
        }
        for stamps in &self.stamps {
            let Stamps { command_published_at, received_at, applied_at, .. } = *stamps;
            prop_assert!(command_published_at <= received_at && received_at <= applied_at);
        }
        Ok(())
    }
}

fn happening() -> impl Strategy<Value = Happening> {
    prop_oneof![
        20 => Just(Happening::Flight),
        2 => Just(Happening::Old),
        1 => Just(Happening::Future),
        2 => Just(Happening::Disarmed),
        4 => Just(Happening::Nothing),
        1 => Just(Happening::PortLost),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn nothing_old_is_ever_sent(happenings in prop::collection::vec(happening(), 100..300)) {
        for language in &LANGUAGES {
            let mut flight = Flight::new(language);
            flight.until_airborne(language.name);
            happenings.iter().for_each(|happening| flight.happen(*happening));
            flight.check(language.name)?;
        }
    }

    #[test]
    fn after_the_last_command_at_most_four_frames_are_not_zero(
        happenings in prop::collection::vec(happening(), 0..60),
    ) {
        for language in &LANGUAGES {
            let mut flight = Flight::new(language);
            flight.until_airborne(language.name);
            happenings.iter().for_each(|happening| flight.happen(*happening));
            let before = flight.flights();
            (0..120).for_each(|_| flight.happen(Happening::Nothing));
            let after = flight.flights() - before;
            prop_assert!(after <= 4, "{}: {} frames", language.name, after);
            let last = flight.sent.iter().rev().take(30);
            prop_assert!(last.clone().count() == 30);
            prop_assert!(last.clone().all(|sent| sent.what == Understood::NoThrust));
        }
    }

    #[test]
    fn a_flight_is_not_resumed_after_a_loss_until_there_was_no_request(lost_after in 1..200_usize) {
        for language in &LANGUAGES {
            let mut flight = Flight::new(language);
            flight.until_airborne(language.name);
            (0..lost_after).for_each(|_| flight.happen(Happening::Flight));
            flight.happen(Happening::PortLost);
            let before = flight.flights();
            (0..300).for_each(|_| flight.happen(Happening::Flight));
            prop_assert_eq!(flight.flights(), before, "{}", language.name);
            flight.until_airborne(language.name);
        }
    }
}
