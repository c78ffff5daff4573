//! A bridge, the vehicle at its other end, and the rules that hold for every frame between them.

use std::collections::BTreeMap;

use oqtal_bridge::{Bridge, Note, VehicleReport};
use oqtal_bus::code::{Actuation, VehicleLink};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps};
use oqtal_bus::stop::StoppedMotors;
use oqtal_bus::time::{Span, Time};
use proptest::prelude::*;

use super::protocol::{Protocol, ProtocolVehicle, Understood};

pub const PERIOD: Span = Span::from_nanos(16_666_667);
/// `bridge.command-timeout-periods` as shipped: three periods.
pub const COMMAND_AGE: Span = Span::from_nanos(50_000_001);
/// Steps of a stick that every protocol resolves \[1/s\].
const STICK_STEPS: f64 = 400.0;
/// Commands that differ in their roll stick \[-\].
const COMMANDS: u64 = 350;
/// Longest frame of any protocol \[bytes\].
const LONGEST_FRAME: usize = 280;
/// Periods within which every vehicle is set up, and within which it flies after the request \[-\].
const SET_UP: usize = 600;

/// Something that happens.
#[derive(Clone, Debug)]
pub enum Happening {
    /// A command with this age since publication arrives \[us\]; negative for the future.
    Command { flies: bool, age_us: i64 },
    /// A pose with this age since publication arrives \[us\].
    Pose { age_us: i64 },
    /// Somebody beside the vehicle starts or stops its motors, or takes it over.
    Somebody { motors_on: bool, is_piloted: bool },
    /// Arbitrary bytes arrive.
    Noise(Vec<u8>),
    /// The port is lost and opened again.
    PortLost,
    /// Time passes.
    Nothing,
}

impl Happening {
    /// A fresh flight command.
    pub const FLIGHT: Self = Self::Command { flies: true, age_us: 1000 };
    /// A fresh command to be disarmed.
    pub const DISARMED: Self = Self::Command { flies: false, age_us: 1000 };
}

/// Bridge and vehicle of one protocol.
pub struct Exchange {
    name: &'static str,
    bridge: Bridge,
    pub vehicle: Box<dyn ProtocolVehicle>,
    /// Whether everything that the vehicle sends is lost.
    pub is_silent: bool,
    now: Time,
    commands: u64,
    /// Publication of the newest flight commands, by number.
    published: BTreeMap<u64, Time>,
    /// Publication of each pose, by its capture \[us\].
    poses: BTreeMap<u64, Time>,
    /// Nothing was commanded since the port was opened.
    is_first: bool,
    /// Everything that the vehicle understood as a command.
    pub understood: Vec<Understood>,
}

impl Exchange {
    pub fn new(protocol: &Protocol) -> Self {
        let now = Time::VIRTUAL_START;
        let mut bridge = (protocol.bridge)(now);
        bridge.open(now);
        Self {
            name: protocol.name,
            bridge,
            vehicle: (protocol.vehicle)(),
            is_silent: false,
            now,
            commands: 0,
            published: BTreeMap::new(),
            poses: BTreeMap::new(),
            is_first: true,
            understood: Vec::new(),
        }
    }

    /// Lets something happen, and periods pass.
    pub fn happen(&mut self, what: &Happening, periods: usize) -> Result<(), TestCaseError> {
        let now = self.now;
        match what {
            Happening::Command { flies, age_us } => self.command(*flies, *age_us),
            Happening::Pose { age_us } => self.pose(*age_us),
            Happening::Somebody { motors_on, is_piloted } => {
                self.vehicle.manual_override(*motors_on, *is_piloted);
            }
            Happening::Noise(bytes) => {
                // A false beginning takes what follows for its frame: the quiet that ends the longest one follows at once, so that
                // the vehicle's next frame is received.
                let noise = [&bytes[..], &[0; LONGEST_FRAME]].concat();
                self.bridge.receive_bytes(now, &noise, &mut |_: Note| {});
            }
            Happening::PortLost => {
                self.bridge.close(now);
                self.bridge.open(now);
                self.is_first = true;
            }
            Happening::Nothing => {}
        }
        (0..periods).try_for_each(|_| self.pass_period())
    }

    /// Lets the vehicle be set up and flown, by commands in every period.
    pub fn until_airborne(&mut self) -> Result<(), TestCaseError> {
        (0..SET_UP).try_for_each(|_| self.happen(&Happening::DISARMED, 1))?;
        let before = self.flights();
        for _ in 0..SET_UP {
            self.happen(&Happening::FLIGHT, 1)?;
            if self.flights() > before {
                return Ok(());
            }
        }
        Err(TestCaseError::fail(format!("{}: the vehicle does not fly", self.name)))
    }

    /// Ends the bridge.
    pub fn end(&mut self) -> Result<(), TestCaseError> {
        let mut answers = Vec::new();
        for _ in 0..3 {
            self.bridge.begin_final_zero_setpoint(self.now);
            self.send(&mut answers)?;
        }
        self.bridge.begin_final_emergency_stop(self.now);
        self.send(&mut answers)
    }

    /// Flight set-points since the beginning \[-\].
    pub fn flights(&self) -> usize {
        self.understood.iter().filter(|frame| matches!(frame, Understood::Flight(_))).count()
    }

    /// The vehicle's time-out as the bridge reports it \[s\].
    pub fn time_out_s(&mut self) -> f64 {
        self.bridge.report(self.now, None, Span::ZERO).2.time_out_s
    }

    /// Raises an operator's stop.
    pub fn raise_stop(&mut self) {
        self.bridge.keep_stopped(Some(self.now));
    }

    /// Whether the bridge reports that the motors are off, also to an operator who has raised a stop.
    pub fn reports_motors_off(&mut self) -> bool {
        let vehicle = self.bridge.report(self.now, None, Span::ZERO).2;
        let is_known = vehicle.link == VehicleLink::Answers.code();
        let is_off = is_known && (vehicle.armed, vehicle.starting) == (0, 0);
        is_off || self.bridge.stopped_motors() == Some(StoppedMotors::Off)
    }

    fn command(&mut self, flies: bool, age_us: i64) {
        self.commands += 1;
        let published_at = self.now - Span::from_nanos(age_us * 1000);
        let stamps = Stamps { command_published_at: published_at, ..Stamps::default() };
        let header = Header { sequence: self.commands, stamps, ..Header::default() };
        let number = self.commands % COMMANDS + 1;
        let flight = CommandV1 {
            actuation: Actuation::Sticks.code(),
            sticks: [number as f64 / STICK_STEPS, 0.0, 0.0],
            thrust: 0.3,
            ..CommandV1::default()
        };
        if flies {
            self.published.insert(number, published_at);
        }
        let command = if flies { flight } else { CommandV1::default() };
        self.bridge.receive_command(self.now, &header, command, 0);
    }

    fn pose(&mut self, age_us: i64) {
        let published = self.now - Span::from_nanos(age_us * 1000);
        let captured_at = published - Span::from_millis(15);
        let stamps = Stamps { captured_at, pose_published_at: published, ..Stamps::default() };
        let pose = PoseV1 { attitude: [0.0, 0.0, 0.0, 1.0], tracked: 1, ..PoseV1::default() };
        let header = Header { stamps, ..Header::default() };
        self.bridge.receive_pose(self.now, &header, &pose);
        self.poses.insert(captured_at.nanos() / 1000, published);
    }

    /// Lets a period pass in milliseconds.
    fn pass_period(&mut self) -> Result<(), TestCaseError> {
        let end = self.now + PERIOD;
        while self.now < end {
            let mut answers = Vec::new();
            self.vehicle.tick(self.now, &mut answers);
            self.receive_vehicle(&mut answers);
            if self.bridge.next_event(self.now) <= self.now {
                self.bridge.begin_read(self.now);
                let unsent = self.bridge.turn(self.now, &mut |_: Note| {});
                self.check_report(unsent)?;
                self.send(&mut answers)?;
                while self.bridge.follow_up(self.now) {
                    self.send(&mut answers)?;
                }
                self.receive_vehicle(&mut answers);
            }
            self.now = self.now + Span::from_millis(1).min(end.since(self.now));
        }
        Ok(())
    }

    fn send(&mut self, answers: &mut Vec<Vec<u8>>) -> Result<(), TestCaseError> {
        let frame = self.bridge.outbox().to_vec();
        if frame.is_empty() {
            return Ok(());
        }
        // The bridge has received the vehicle's reports.
        let is_piloted = self.vehicle.told_piloted();
        let understood = self.vehicle.take(self.now, &frame, answers);
        let report = self.bridge.handed_over(self.now, frame.len());
        self.check_report(report)?;
        self.check(understood, is_piloted)
    }

    fn receive_vehicle(&mut self, answers: &mut Vec<Vec<u8>>) {
        for answer in answers.drain(..).filter(|_| !self.is_silent) {
            self.bridge.receive_bytes(self.now, &answer, &mut |_| {});
        }
    }

    fn check(&mut self, understood: Understood, is_piloted: bool) -> Result<(), TestCaseError> {
        let name = self.name;
        if understood.commands() {
            prop_assert!(!is_piloted, "{name}: {understood:?} while a pilot flies");
            let is_quiet = !self.is_first || understood == Understood::Zero;
            prop_assert!(is_quiet, "{name}: {understood:?} first");
            self.is_first = false;
            self.understood.push(understood);
        }
        match understood {
            Understood::Flight(stick) => {
                let number = (stick * STICK_STEPS).round() as u64;
                let at = self.published.get(&number);
                prop_assert!(at.is_some(), "{name}: stick {stick} was not commanded");
                self.check_age(at.copied(), "command")
            }
            Understood::Pose(Some(captured)) => {
                let at = self.poses.get(&captured).copied();
                prop_assert!(at.is_some(), "{name}: a pose of another time");
                self.check_age(at, "pose")
            }
            _ => Ok(()),
        }
    }

    /// Checks that what was published then is young.
    fn check_age(&self, published: Option<Time>, what: &str) -> Result<(), TestCaseError> {
        let young = published.is_some_and(|at| at <= self.now && self.now.since(at) <= COMMAND_AGE);
        prop_assert!(young, "{}: a {what} of {published:?} is sent at {:?}", self.name, self.now);
        Ok(())
    }

    fn check_report(&self, report: Option<VehicleReport>) -> Result<(), TestCaseError> {
        let Some((_, stamps, vehicle)) = report else { return Ok(()) };
        let Stamps { command_published_at, received_at, applied_at, .. } = stamps;
        if applied_at.is_set() {
            prop_assert!(command_published_at <= received_at && received_at <= applied_at);
            prop_assert!(applied_at.since(command_published_at) <= COMMAND_AGE);
            prop_assert!(vehicle.command_sequence > 0);
        }
        Ok(())
    }
}
