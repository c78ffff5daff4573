//! How a process waits for its next event: on the real clock and a listener, or for a time advance in virtual time.
//!
//! Under either clock a process is one loop: `while let Some(now) = clock.wait(next_event)? { act(now) }`.

use crate::health::Health;
use crate::lockstep::{Follower, Leader};
use crate::stop::{STOP_CHECK, StopFlag};
use crate::turn::TurnClock;
use crate::virtual_clock::TurnResult;
use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::time::Time;
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
    now: Time,
    published: bool,
}

#[derive(Debug)]
enum Clock {
    Real(Box<Listener>),
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

    /// Virtual time of the flight under `config`, advanced by this process for all of `roles`, of which it is the first.
    ///
    /// # Errors
    /// The bus refuses, or another process leads virtual time already.
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
        Self { clock, stop, health: Health::default(), now, published: false }
    }

    /// Counts the turns in `health`.
    #[must_use]
    pub fn counted_in(self, health: Health) -> Self {
        Self { health, ..self }
    }

    /// The present instant: read from the clock, or as virtual time was last advanced.
    #[must_use]
    pub fn now(&self) -> Time {
        match self.clock {
            Clock::Real(_) => Time::now(),
            Clock::Leader(_) | Clock::Follower(_) => self.now,
        }
    }

    /// Whether this process runs under virtual time.
    #[must_use]
    pub fn is_virtual(&self) -> bool {
        !matches!(self.clock, Clock::Real(_))
    }

    /// Waits until `next` or until an arrival; returns the present instant, or `None` once the process is asked to stop. May
    /// return early: the caller checks what is due.
    ///
    /// # Errors
    /// The bus broke.
    pub fn wait(&mut self, next: Option<Time>) -> Result<Option<Time>, BusError> {
        self.health.count_turn();
        if self.stop.is_set() {
            return Ok(None);
        }
        let result = TurnResult { next, published: std::mem::take(&mut self.published) };
        let woken = match &mut self.clock {
            Clock::Real(listener) => {
                listener.wait(next, STOP_CHECK)?;
                Some(Time::now())
            }
            Clock::Leader(leader) => leader.wait(result, &self.stop)?,
            Clock::Follower(follower) => follower.wait(result, &self.stop)?,
        };
        self.now = woken.unwrap_or(self.now);
        Ok(woken.filter(|_| !self.stop.is_set()))
    }
}

impl TurnClock for LoopClock {
    fn now(&self) -> Time {
        LoopClock::now(self)
    }

    fn announce<M: Message>(&mut self, writer: &impl Publish<M>) -> Result<(), BusError> {
        if self.is_virtual() {
            self.published = true;
            Ok(())
        } else {
            writer.notify()
        }
    }
}
