//! Wait for the next event of a process: on the real clock and a listener or a descriptor, or for a time advance in virtual time.
//!
//! With either clock a process is one loop: `while let Some(now) = clock.wait(next_event)? { act(now) }`.

use std::os::fd::OwnedFd;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::awake::AwakeInterval;
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
    /// Interval in which the loop waits by polling; `None` for none, as in virtual time.
    awake: Option<AwakeInterval>,
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
        let (health, awake) = (Health::default(), None);
        Self { clock, awake, stop, health, overruns, due: None, now, published: false }
    }

    /// Records the state of the motors after a turn.
    pub(crate) fn note_motors(&self, motors: MotorActivity) {
        self.health.set_motors(motors);
    }

    /// Counts the turns in `health`; a turn that ends more than `period` after it was due is late.
    pub fn counted_in(self, health: Health, period: Span) -> Self {
        Self { health, overruns: OverrunMonitor::new(period), ..self }
    }

    /// Waits awake in this interval around each expected arrival; has no effect in virtual time.
    pub fn awake_in(self, awake: Option<AwakeInterval>) -> Self {
        Self { awake, ..self }
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
                Some(wait_for(next, &mut self.awake, Time::now, |until| listener.wait(until))?)
            }
            Clock::Polled(descriptor) => {
                Some(wait_for(next, &mut self.awake, Time::now, |until| {
                    wait_readable(descriptor, until)
                })?)
            }
            Clock::Leader(leader) => leader.wait(result, &self.stop)?,
            Clock::Follower(follower) => follower.wait(result, &self.stop)?,
        };
        self.now = woken.unwrap_or(self.now);
        self.due = Some(next.map_or(self.now, |next| next.min(self.now)));
        Ok(woken.filter(|_| !self.stop.is_set()))
    }
}

/// Waits for an arrival until `next`, for at most [`STOP_CHECK`], and awake in the interval `awake`; returns the present instant. `sleep`
/// sleeps until an arrival or an instant and returns whether there was an arrival; at a past instant it returns at once.
fn wait_for(
    next: Option<Time>,
    awake: &mut Option<AwakeInterval>,
    clock: impl Fn() -> Time,
    sleep: impl Fn(Time) -> Result<bool, BusError>,
) -> Result<Time, BusError> {
    let now = clock();
    let latest = now + STOP_CHECK;
    let until = next.map_or(latest, |next| next.min(latest));
    let mut has_arrived = false;
    if let Some([start, end]) = awake.as_ref().and_then(|awake| awake.bounds(now)) {
        has_arrived = sleep(start.min(until))?;
        while !has_arrived && (start..end.min(until)).contains(&clock()) {
            std::hint::spin_loop();
            has_arrived = sleep(start)?;
        }
    }
    if !has_arrived {
        has_arrived = sleep(until)?;
    }
    let now = clock();
    if let (true, Some(awake)) = (has_arrived, awake) {
        awake.expect_after(now);
    }
    Ok(now)
}

/// Sleeps until `descriptor` is readable or until `deadline`; returns whether it is readable. May return early.
fn wait_readable(descriptor: &OwnedFd, deadline: Time) -> Result<bool, BusError> {
    let nanos = deadline.since(Time::now()).max(Span::ZERO).nanos();
    let timeout = Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 };
    match poll(&mut [PollFd::new(descriptor, PollFlags::IN)], Some(&timeout)) {
        Ok(ready) => Ok(ready > 0),
        Err(Errno::INTR) => Ok(false),
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

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use super::*;

    /// Waits in a world whose clock advances by 10 us with each look at it, with an arrival at `arrives`; returns the end of the wait and
    /// the instants until which the loop slept.
    fn waited(awake: &mut Option<AwakeInterval>, arrives: Time, next: Time) -> (Time, Vec<Time>) {
        let now = Cell::new(Time::VIRTUAL_START);
        let sleeps = RefCell::new(Vec::new());
        let clock = || now.replace(now.get() + Span::from_nanos(10_000));
        let sleep = |until: Time| {
            if until > now.get() {
                sleeps.borrow_mut().push(until);
                now.set(until.min(arrives).max(now.get()));
            }
            Ok(now.get() >= arrives)
        };
        let end = wait_for(Some(next), awake, clock, sleep).unwrap();
        (end, sleeps.into_inner())
    }

    #[test]
    fn a_loop_sleeps_until_the_interval_and_is_awake_in_it() {
        let mut config = Config::default();
        (config.realtime.awake_us, config.realtime.cpus) = (300.0, vec![0, 1, 2]);
        let ms = |ms: i64| Time::VIRTUAL_START + Span::from_millis(ms);
        let next = ms(19);
        let mut awake = AwakeInterval::of(&config, Role::Daemon);
        assert_eq!(waited(&mut awake, ms(1), next).1, [next], "no arrival is expected yet");
        let [start, end] = awake.as_ref().unwrap().bounds(ms(1)).unwrap();
        let in_interval = start + Span::from_nanos(200_000);
        let mut kept = awake.clone();
        let (woken, sleeps) = waited(&mut kept, in_interval, next);
        assert_eq!(sleeps, [start], "awake");
        assert!(woken >= in_interval && woken < in_interval + Span::from_nanos(50_000));
        assert!(kept.unwrap().bounds(woken).unwrap()[0] > end, "the next arrival is expected");
        assert_eq!(waited(&mut awake, next, next).1, [start, next], "asleep after the interval");
    }
}
