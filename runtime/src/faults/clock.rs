//! Clock of faults: present instant of a turn, and instant of the first command that arms, from which the times of faults count.

use std::cell::{Cell, RefCell};

use oqtal_bus::code::Actuation;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::Fault;

/// Watches topic `command` for the first command that arms.
#[derive(Debug)]
pub struct ArmingWatch<T: Transport> {
    /// Reader; `None` if no time counts from arming.
    commands: Option<T::Reader<CommandV1>>,
    armed_at: Option<Time>,
}

impl<T: Transport> ArmingWatch<T> {
    /// Opens a reader of topic `command`, if it is needed.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, is_needed: bool) -> Result<Self, BusError> {
        let commands = is_needed.then(|| bus.observer(&COMMAND)).transpose()?;
        Ok(Self { commands, armed_at: None })
    }

    /// Instant at which the daemon published its first command that arms; `None` before it, or if it is not needed. The stamp is
    /// the daemon's, so that all processes use the same instant.
    ///
    /// # Errors
    /// The transport failed.
    pub fn armed_at(&mut self) -> Result<Option<Time>, BusError> {
        let Some(commands) = &mut self.commands else { return Ok(None) };
        while self.armed_at.is_none() {
            let Some((header, command)) = commands.receive()? else { break };
            if command.actuation != Actuation::Disarmed.code() {
                self.armed_at = Some(header.stamps.command_published_at);
            }
        }
        Ok(self.armed_at)
    }
}

/// Clock of one process's faults.
#[derive(Debug)]
pub(super) struct FaultClock<T: Transport> {
    now: Cell<Time>,
    armed_at: Cell<Option<Time>>,
    arming: RefCell<ArmingWatch<T>>,
    /// States of the vehicle, read to restrict faults to simulated vehicles; `None` if faults may act on any vehicle.
    vehicles: RefCell<Option<T::Reader<VehicleV1>>>,
    /// Whether the vehicle was found not to be simulated.
    is_refused: Cell<bool>,
    /// Due instants of delayed samples, by port.
    due: RefCell<Vec<Option<Time>>>,
}

impl<T: Transport> FaultClock<T> {
    /// Clock for faults that act on any vehicle, or only on a simulated one if `any_vehicle` is false.
    pub(super) fn open(bus: &T, any_vehicle: bool) -> Result<Self, BusError> {
        let vehicles = (!any_vehicle).then(|| bus.reader(&VEHICLE)).transpose()?;
        Ok(Self {
            now: Cell::new(Time::UNSET),
            armed_at: Cell::new(None),
            arming: RefCell::new(ArmingWatch::open(bus, true)?),
            vehicles: RefCell::new(vehicles),
            is_refused: Cell::new(false),
            due: RefCell::new(Vec::new()),
        })
    }

    /// Begins a turn at `now`.
    pub(super) fn begin(&self, now: Time) -> Result<(), BusError> {
        self.now.set(now);
        if self.armed_at.get().is_none() {
            self.armed_at.set(self.arming.borrow_mut().armed_at()?);
        }
        if let Some(vehicles) = self.vehicles.borrow_mut().as_mut() {
            while let Some((_, vehicle)) = vehicles.receive()? {
                self.is_refused.set(self.is_refused.get() || vehicle.simulated == 0);
            }
        }
        Ok(())
    }

    /// The instant of the turn.
    pub(super) fn now(&self) -> Time {
        self.now.get()
    }

    /// Whether `fault` acts in this turn.
    pub(super) fn acts(&self, fault: &Fault) -> bool {
        let Some(armed_at) = self.armed_at.get().filter(|_| !self.is_refused.get()) else {
            return false;
        };
        is_within(interval(fault.at_s, fault.duration_s, armed_at), self.now())
    }

    /// Index of a new port, for [`FaultClock::set_due`].
    pub(super) fn add_port(&self) -> usize {
        self.due.borrow_mut().push(None);
        self.due.borrow().len() - 1
    }

    /// Sets the instant at which the next delayed sample of `port` is due.
    pub(super) fn set_due(&self, port: usize, due: Option<Time>) {
        self.due.borrow_mut()[port] = due;
    }

    /// The instant at which the first delayed sample of all ports is due.
    pub(super) fn next_due(&self) -> Option<Time> {
        self.due.borrow().iter().flatten().min().copied()
    }
}

/// Interval that starts at `at_s` and lasts `duration_s` \[s\], in a flight armed at `armed_at`; the end is `None` for an
/// unlimited interval.
pub fn interval(at_s: f64, duration_s: Option<f64>, armed_at: Time) -> (Time, Option<Time>) {
    let from = armed_at + Span::from_seconds(at_s);
    (from, duration_s.map(|duration_s| from + Span::from_seconds(duration_s)))
}

/// Whether `now` is in this interval.
pub fn is_within((from, until): (Time, Option<Time>), now: Time) -> bool {
    from <= now && until.is_none_or(|until| now < until)
}
