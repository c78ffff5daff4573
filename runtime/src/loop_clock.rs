//! Wait for the next event of a process: on the real clock and a listener or a descriptor, or for a time advance in virtual time.
//!
//! With either clock a process is one loop: `while let Some(now) = clock.wait(next_event)? { act(now) }`.

use std::os::fd::OwnedFd;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::health::{Health, MotorActivity};
use crate::lockstep::{Follower, Leader};
use crate::overrun::OverrunMonitor;
use crate::stop::{STOP_CHECK, StopFlag};
use crate::turn::TurnClock;
use crate::virtual_clock::TurnResult;
use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, Topic};
use oqtal_bus::transport::Publish;
use oqtal_bus::wake::Listener;
use oqtal_config::Config;

/// Waits for the next event of one process.
#[derive(Debug)]
pub struct LoopClock {
    clock: Clock,
    stop: StopFlag,
    health: Health,
    overruns: OverrunMonitor,
    /// Instant at which the present turn was due; `None` before the first.
    due: Option<Time>,
    now: Time,
    published: bool,
}

#[derive(Debug)]
enum Clock {
    Real(Box<Listener>),
    Polled(OwnedFd),
    Leader(Box<Leader>),
    Follower(Box<Follower>),
}

impl LoopClock {
    /// Real time: wakes at the next event, or when `wakes_on` is notified.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn real<M: Message>(
        bus: &Bus,
        wakes_on: &Topic<M>,
        stop: StopFlag,
    ) -> Result<Self, BusError> {
        Ok(Self::new(Clock::Real(Box::new(bus.listener(wakes_on)?)), stop, Time::now()))
    }

    /// Real time: wakes at the next event, or when `descriptor` is readable; an epoll set is readable when one of its sockets is.
    pub fn polled(descriptor: OwnedFd, stop: StopFlag) -> Self {
        Self::new(Clock::Polled(descriptor), stop, Time::now())
    }

    /// Virtual time of the flight under `config`, advanced by this process for all of `roles`; this process is the first of them.
    ///
    /// # Errors
    /// The bus refuses, or another process already leads virtual time.
    pub fn leader(
        bus: &Bus,
        roles: &[Role],
        config: &Config,
        stop: StopFlag,
    ) -> Result<Self, BusError> {
        let leader = Leader::open(bus, roles, config)?;
        Ok(Self::new(Clock::Leader(Box::new(leader)), stop, Time::VIRTUAL_START))
    }

    /// Virtual time, advanced for `role` by the leader.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn follower(bus: &Bus, role: Role, stop: StopFlag) -> Result<Self, BusError> {
        let follower = Follower::open(bus, role)?;
        Ok(Self::new(Clock::Follower(Box::new(follower)), stop, Time::VIRTUAL_START))
    }

    fn new(clock: Clock, stop: StopFlag, now: Time) -> Self {
        let overruns = OverrunMonitor::new(Span::from_millis(1000));
        Self { clock, stop, health: Health::default(), overruns, due: None, now, published: false }
    }

    /// Records the state of the motors after a turn.
    pub(crate) fn note_motors(&self, motors: MotorActivity) {
        self.health.set_motors(motors);
    }

    /// Counts the turns in `health`; a turn that ends more than `period` after it was due is late.
    pub fn counted_in(self, health: Health, period: Span) -> Self {
        Self { health, overruns: OverrunMonitor::new(period), ..self }
    }

    /// The present instant: read from the clock, or the last virtual time.
    pub fn now(&self) -> Time {
        match self.clock {
            Clock::Real(_) | Clock::Polled(_) => Time::now(),
            Clock::Leader(_) | Clock::Follower(_) => self.now,
        }
    }

    /// Whether this process runs in virtual time.
    pub fn is_virtual(&self) -> bool {
        !matches!(self.clock, Clock::Real(_) | Clock::Polled(_))
    }

    /// Records whether the last turn was late. Virtual time waits for every turn.
    fn record_overrun(&mut self) {
        if let (false, Some(due)) = (self.is_virtual(), self.due) {
            self.overruns.turn_ended(due, Time::now());
            self.health.set_overruns(&self.overruns);
        }
    }

    /// Waits until `next` or until an arrival; returns the present instant, or `None` once a stop is requested. May return early;
    /// the caller checks which events are due.
    ///
    /// # Errors
    /// The bus failed.
    pub fn wait(&mut self, next: Option<Time>) -> Result<Option<Time>, BusError> {
        self.health.count_turn();
        self.record_overrun();
        if self.stop.is_set() {
            return Ok(None);
        }
        let result = TurnResult { next, published: std::mem::take(&mut self.published) };
        let woken = match &mut self.clock {
            Clock::Real(listener) => {
                listener.wait(next, STOP_CHECK)?;
                Some(Time::now())
            }
            Clock::Polled(descriptor) => {
                wait_readable(descriptor, next, STOP_CHECK)?;
                Some(Time::now())
            }
            Clock::Leader(leader) => leader.wait(result, &self.stop)?,
            Clock::Follower(follower) => follower.wait(result, &self.stop)?,
        };
        self.now = woken.unwrap_or(self.now);
        self.due = Some(next.map_or(self.now, |next| next.min(self.now)));
        Ok(woken.filter(|_| !self.stop.is_set()))
    }
}

/// Sleeps until `descriptor` is readable or until `deadline`, for at most `longest`. May return early.
fn wait_readable(
    descriptor: &OwnedFd,
    deadline: Option<Time>,
    longest: Span,
) -> Result<(), BusError> {
    let timeout = deadline.map_or(longest, |deadline| deadline.since(Time::now()).min(longest));
    let nanos = timeout.max(Span::ZERO).nanos();
    let timeout = Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 };
    match poll(&mut [PollFd::new(descriptor, PollFlags::IN)], Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => {
            let action = "waiting for the network".to_owned();
            Err(BusError::System { action, reason: error.to_string() })
        }
    }
}

impl TurnClock for LoopClock {
    fn now(&self) -> Time {
        LoopClock::now(self)
    }

    fn runs_late(&self) -> bool {
        self.overruns.runs_late()
    }

    fn announce<M: Message>(&mut self, writer: &impl Publish<M>) -> Result<(), BusError> {
        self.health.count_output();
        if self.is_virtual() {
            self.published = true;
            Ok(())
        } else {
            writer.notify()
        }
    }
}
