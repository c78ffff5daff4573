//! Virtual time between processes: the leader executes the virtual clock and advances the followers, one at a time.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{Stamps, TimeAdvanceV1, TurnDoneV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_bus::wake::Listener;
use oqtal_config::Config;

use crate::faults::outage::TurnFaults;
use crate::stop::{STOP_CHECK, StopFlag};
use crate::virtual_clock::{TurnResult, VirtualClock};

/// Period of the start barrier's requests.
const START_POLL: Span = Span::from_millis(20);

/// The process that advances virtual time.
#[derive(Debug)]
pub(crate) struct Leader {
    role: Role,
    followers: Vec<FollowerLink>,
    virtual_clock: VirtualClock,
    faults: TurnFaults<Bus>,
    started: bool,
}

impl Leader {
    /// Opens the links from the first of `roles` to the others, with the faults of `config`.
    ///
    /// # Errors
    /// The bus refuses, or another process already leads virtual time.
    pub fn open(bus: &Bus, roles: &[Role], config: &Config) -> Result<Self, BusError> {
        let role = roles[0];
        let followers = roles.iter().filter(|&&other| other != role);
        Ok(Self {
            role,
            followers: followers
                .map(|&other| FollowerLink::open(bus, other))
                .collect::<Result<_, _>>()?,
            virtual_clock: VirtualClock::new(Time::VIRTUAL_START, roles),
            faults: TurnFaults::open(bus, config)?,
            started: false,
        })
    }

    /// Ends the leader's turn with `result` and advances the followers until the leader's next turn; returns its instant, or
    /// `None` once a stop is requested.
    ///
    /// # Errors
    /// The bus failed.
    pub fn wait(&mut self, result: TurnResult, stop: &StopFlag) -> Result<Option<Time>, BusError> {
        if self.started {
            self.virtual_clock.done(self.role, result);
        } else {
            // The start barrier: virtual time begins once all followers have joined.
            for link in &mut self.followers {
                if !link.await_start(stop)? {
                    return Ok(None);
                }
            }
            self.started = true;
        }
        while let Some((role, now)) = self.virtual_clock.turn() {
            let Some(link) = self.followers.iter_mut().find(|link| link.role == role) else {
                return Ok(Some(now));
            };
            let Some(answer) = link.advance(now, stop)? else {
                return Ok(None);
            };
            self.virtual_clock.done(role, answer);
            if let Some(outages) = self.faults.begin()? {
                self.virtual_clock.set_outages(outages);
            }
        }
        Ok(None)
    }
}

/// The leader's link to one follower.
#[derive(Debug)]
struct FollowerLink {
    role: Role,
    advances: Writer<TimeAdvanceV1>,
    results: Reader<TurnDoneV1>,
    listener: Listener,
}

impl FollowerLink {
    fn open(bus: &Bus, role: Role) -> Result<Self, BusError> {
        Ok(Self {
            role,
            results: bus.reader(&role.turn_done())?,
            listener: bus.listener(&role.turn_done())?,
            advances: bus.writer(&role.time_advance())?,
        })
    }

    /// Waits until the follower has joined; `false` once a stop is requested.
    fn await_start(&mut self, stop: &StopFlag) -> Result<bool, BusError> {
        while !stop.is_set() {
            // Repeated, since a follower that joins after this message misses it.
            self.send(Time::UNSET)?;
            self.listener.wait(Time::now() + START_POLL)?;
            if self.results.latest()?.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Advances the follower to `now` and waits without limit for the result of its turn; `None` once a stop is requested.
    fn advance(&mut self, now: Time, stop: &StopFlag) -> Result<Option<TurnResult>, BusError> {
        let sequence = self.send(now)?;
        while !stop.is_set() {
            self.listener.wait(Time::now() + STOP_CHECK)?;
            match self.results.latest()? {
                Some((_, done)) if done.advance == sequence => {
                    let next = done.next.is_set().then_some(done.next);
                    return Ok(Some(TurnResult { next, published: done.published != 0 }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    fn send(&mut self, now: Time) -> Result<u64, BusError> {
        let sequence = self.advances.send(0, Stamps::default(), TimeAdvanceV1 { now })?;
        self.advances.notify()?;
        Ok(sequence)
    }
}

/// Process whose virtual time the leader advances.
#[derive(Debug)]
pub(crate) struct Follower {
    advances: Reader<TimeAdvanceV1>,
    listener: Listener,
    results: Writer<TurnDoneV1>,
    /// Sequence number of the advance whose turn is in progress.
    turn: Option<u64>,
}

impl Follower {
    /// Opens the link from the leader to `role`.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn open(bus: &Bus, role: Role) -> Result<Self, BusError> {
        Ok(Self {
            advances: bus.reader(&role.time_advance())?,
            listener: bus.listener(&role.time_advance())?,
            results: bus.writer(&role.turn_done())?,
            turn: None,
        })
    }

    /// Ends the follower's turn with `result` and waits for the next advance; returns its instant, or `None` once a stop is
    /// requested.
    ///
    /// # Errors
    /// The bus failed.
    pub fn wait(&mut self, result: TurnResult, stop: &StopFlag) -> Result<Option<Time>, BusError> {
        if let Some(advance) = self.turn.take() {
            self.reply(advance, result)?;
        }
        while !stop.is_set() {
            match self.advances.latest()? {
                Some((header, advance)) if advance.now.is_set() => {
                    self.turn = Some(header.sequence);
                    return Ok(Some(advance.now));
                }
                // The start barrier.
                Some((header, _)) => self.reply(header.sequence, result)?,
                None => drop(self.listener.wait(Time::now() + STOP_CHECK)?),
            }
        }
        Ok(None)
    }

    fn reply(&mut self, advance: u64, result: TurnResult) -> Result<(), BusError> {
        let next = result.next.unwrap_or(Time::UNSET);
        let published = u8::from(result.published);
        self.results.send(0, Stamps::default(), TurnDoneV1 { advance, next, published })?;
        self.results.notify()
    }
}
