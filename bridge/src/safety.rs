//! What may be said to the vehicle: the newest command while it is young, else neutral. Knows neither format nor link, asks
//! nobody, and judges by the bridge's own clock.
//!
//! A command's age is counted from its publication, which the daemon stamped by the same machine's clock, and from its arrival
//! here: it must be young by both. A stamp that is missing or lies ahead is not believed. So a command that lay in a buffer
//! while this process was stopped is never sent, however late it is found.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};

use crate::motors::{MotorChange, MotorConditions, MotorSequencer, MotorState};

/// What a frame tells the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleSetpoint {
    /// Sticks centred, no thrust.
    Zero,
    /// Fly like this: sticks and thrust.
    Fly(CommandV1),
    /// No thrust, and the stick that starts the motors.
    StartMotors,
    /// No thrust, and the stick that stops them.
    StopMotors,
}

/// A command that an setpoint passes on for the first time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForwardedCommand {
    /// Sequence of the command.
    pub command: u64,
    /// Sequence of its pose.
    pub pose: u64,
    /// Its stations, the arrival here included.
    pub stamps: Stamps,
}

/// What the vehicle last said of its motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorStatus {
    /// When it was reply.
    pub heard_at: Time,
    /// Whether they run.
    pub run: bool,
}

/// How long is too long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyLimits {
    /// A command published longer ago is never sent.
    pub command_age: Span,
    /// A status reply longer ago does not count for a motor sequence.
    pub status_age: Span,
    /// A motor sequence lasts no longer.
    pub sequence: Span,
    /// Neutral is commanded for so long before motors are stopped.
    pub rest: Span,
}

/// A command as it arrived.
#[derive(Clone, Copy, Debug)]
struct Newest {
    about: ForwardedCommand,
    command: CommandV1,
    passed_on: bool,
}

/// Decides what a frame says.
#[derive(Clone, Debug)]
pub struct CommandGate {
    limits: SafetyLimits,
    motors: MotorSequencer,
    newest: Option<Newest>,
    status: Option<MotorStatus>,
    /// Since when nobody has wanted to fly.
    unwanted_since: Time,
    /// Since when neutral has been commanded.
    neutral_since: Option<Time>,
    refused: u64,
}

impl CommandGate {
    /// A vehicle of which nothing is known.
    #[must_use]
    pub fn new(now: Time, limits: SafetyLimits) -> Self {
        Self {
            limits,
            motors: MotorSequencer::new(now, limits.sequence),
            newest: None,
            status: None,
            unwanted_since: now,
            neutral_since: None,
            refused: 0,
        }
    }

    /// A port was opened or lost: neutral first, and what was known of the vehicle is not known any more.
    pub fn forget(&mut self, now: Time) {
        self.motors.hold(now);
        self.status = None;
        self.unwanted_since = now;
    }

    /// Takes a command off the bus at `now`; whether it is believed, young and newer than the last.
    pub fn receive(&mut self, now: Time, header: &Header, command: CommandV1) -> bool {
        let published_at = header.stamps.command_published_at;
        let newer =
            self.newest.is_none_or(|last| published_at >= last.about.stamps.command_published_at);
        // The last word of a daemon carries no stamps: neutral is always right.
        let last_word = !is_flight(&command) && !published_at.is_set();
        let believed = last_word || newer && is_young(now, published_at, self.limits.command_age);
        if !believed {
            self.refused += 1;
            return false;
        }
        let stamps = Stamps { received_at: now, ..header.stamps };
        let about =
            ForwardedCommand { command: header.sequence, pose: header.pose_sequence, stamps };
        self.newest = Some(Newest { about, command, passed_on: false });
        if is_flight(&command) {
            self.neutral_since = None;
        } else {
            self.neutral_since = self.neutral_since.or(Some(now));
        }
        true
    }

    /// Takes what the vehicle says of its motors.
    pub fn hear(&mut self, status: MotorStatus) {
        self.status = Some(status);
    }

    /// What a frame that begins `now` says, the command that it passes on for the first time, and what changed.
    pub fn decide(
        &mut self,
        now: Time,
    ) -> (VehicleSetpoint, Option<ForwardedCommand>, Option<MotorChange>) {
        let flight = self.flight(now);
        if flight.is_some() {
            self.unwanted_since = now;
        }
        let conditions = self.conditions(now, flight.is_some());
        let change = self.motors.step(now, conditions);
        let setpoint = match (self.motors.state(), flight) {
            (MotorState::Running, Some(command)) => VehicleSetpoint::Fly(command),
            // A toggle, so only while it is known to be needed.
            (MotorState::Starting, Some(_)) if conditions.stand => VehicleSetpoint::StartMotors,
            (MotorState::Stopping, None) if conditions.run => VehicleSetpoint::StopMotors,
            _ => VehicleSetpoint::Zero,
        };
        (setpoint, self.pass_on(now, &setpoint), change)
    }

    /// Whether the daemon waits for the motors.
    #[must_use]
    pub fn is_starting(&self) -> bool {
        self.motors.state() == MotorState::Starting
    }

    /// Whether a motor sequence is under way: then the vehicle's word is wanted often.
    #[must_use]
    pub fn is_in_sequence(&self) -> bool {
        matches!(self.motors.state(), MotorState::Starting | MotorState::Stopping)
    }

    /// Whether the motors may run because of what was sent here.
    #[must_use]
    pub fn may_run(&self) -> bool {
        self.motors.may_run()
    }

    /// Whether the last status, however old, says that the motors run: one that is missing does not say that they stand. For a
    /// motor sequence it has to be fresh.
    #[must_use]
    pub fn ran_last(&self) -> bool {
        self.status.is_some_and(|status| status.run)
    }

    /// Commands refused: too old, from the future, or older than the one before.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The newest command, if it is one to fly by and young enough to be sent `now`.
    fn flight(&self, now: Time) -> Option<CommandV1> {
        let newest = self.newest.filter(|newest| is_flight(&newest.command))?;
        let Stamps { command_published_at, received_at, .. } = newest.about.stamps;
        let young = |since| is_young(now, since, self.limits.command_age);
        (young(command_published_at) && young(received_at)).then_some(newest.command)
    }

    fn fresh_status(&self, now: Time) -> Option<bool> {
        let status = self.status.filter(|s| is_young(now, s.heard_at, self.limits.status_age))?;
        Some(status.run)
    }

    fn conditions(&self, now: Time, wanted: bool) -> MotorConditions {
        let status = self.fresh_status(now);
        let unwanted = now.since(self.unwanted_since);
        let rested = self.neutral_since.is_some_and(|since| now.since(since) >= self.limits.rest);
        let silent = self.neutral_since.is_none() && unwanted >= self.limits.rest;
        MotorConditions {
            wanted,
            calm: unwanted > self.limits.command_age,
            disarmed: self.neutral_since.is_some(),
            rested: rested && !wanted,
            abandoned: silent && !wanted,
            run: status == Some(true),
            stand: status == Some(false),
            ..MotorConditions::default()
        }
    }

    /// The newest command, if `setpoint` is the first that does what it says.
    fn pass_on(&mut self, now: Time, setpoint: &VehicleSetpoint) -> Option<ForwardedCommand> {
        let newest = self.newest.as_mut().filter(|newest| !newest.passed_on)?;
        let young =
            is_young(now, newest.about.stamps.command_published_at, self.limits.command_age);
        let says_so = match setpoint {
            VehicleSetpoint::Fly(_) => true,
            VehicleSetpoint::Zero => !is_flight(&newest.command) && young,
            VehicleSetpoint::StartMotors | VehicleSetpoint::StopMotors => false,
        };
        newest.passed_on |= says_so;
        says_so.then_some(newest.about)
    }
}

/// Whether a command is one to fly by: sticks, all finite. Whatever else comes is neutral.
fn is_flight(command: &CommandV1) -> bool {
    let CommandV1 { sticks, attitude, thrust, .. } = command;
    let numbers = sticks.iter().chain(attitude).chain([thrust]);
    Actuation::from_code(command.actuation) == Some(Actuation::Sticks)
        && numbers.into_iter().all(|number| number.is_finite())
}

/// Whether `since` is a stamp that lies no further back than `age`, and not ahead.
fn is_young(now: Time, since: Time, age: Span) -> bool {
    since.is_set() && since <= now && now.since(since) <= age
}
