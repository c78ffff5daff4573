//! How a process waits for its next event: for the real clock and a listener, or for a grant of virtual time.
//!
//! A process is one loop under either: `while let Some(now) = pace.wait(next_event)? { act(now) }`.

use crate::health::Health;
use crate::stop::StopFlag;
use crate::turn::TurnClock;
use crate::virtual_clock::{TurnResult, VirtualClock};
use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{Message, Stamps, TimeAdvanceV1, TurnDoneV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, Topic};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_bus::wake::Listener;

/// A sleeping process looks this often whether it was asked to stop.
const STOP_CHECK: Span = Span::from_millis(20);
/// The roll is called this often until every role has answered.
const START_POLL: Span = Span::from_millis(20);

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

    /// Virtual time, and this process, `role`, grants it to the others of `roles`.
    ///
    /// # Errors
    /// The bus refuses, or another process grants it already.
    pub fn leader(bus: &Bus, role: Role, roles: &[Role], stop: StopFlag) -> Result<Self, BusError> {
        let followers = roles.iter().filter(|&&other| other != role);
        let leader = Leader {
            role,
            followers: followers.map(|&other| Link::new(bus, other)).collect::<Result<_, _>>()?,
            virtual_clock: VirtualClock::new(Time::VIRTUAL_START, roles),
            started: false,
        };
        Ok(Self::new(Clock::Leader(Box::new(leader)), stop, Time::VIRTUAL_START))
    }

    /// Virtual time, granted to `role` by the leader.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn follower(bus: &Bus, role: Role, stop: StopFlag) -> Result<Self, BusError> {
        let follower = Follower {
            grants: bus.reader(&role.grant())?,
            listener: bus.listener(&role.grant())?,
            answers: bus.writer(&role.done())?,
            granted: None,
        };
        Ok(Self::new(Clock::Follower(Box::new(follower)), stop, Time::VIRTUAL_START))
    }

    fn new(clock: Clock, stop: StopFlag, now: Time) -> Self {
        Self { clock, stop, health: Health::default(), now, published: false }
    }

    /// Counts its turns in `health`.
    #[must_use]
    pub fn counted_in(self, health: Health) -> Self {
        Self { health, ..self }
    }

    /// The instant now: read from the clock, or as last granted.
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

    /// Sleeps until `next`, or until there is something to look at; returns the instant, or `None` once asked to stop.
    /// May return early: whoever wakes looks for what is due.
    ///
    /// # Errors
    /// The bus broke.
    pub fn wait(&mut self, next: Option<Time>) -> Result<Option<Time>, BusError> {
        self.health.count_turn();
        if self.stop.is_set() {
            return Ok(None);
        }
        let done = TurnResult { next, published: std::mem::take(&mut self.published) };
        let woken = match &mut self.clock {
            Clock::Real(listener) => {
                listener.wait(next, STOP_CHECK)?;
                Some(Time::now())
            }
            Clock::Leader(leader) => leader.wait(done, &self.stop)?,
            Clock::Follower(follower) => follower.wait(done, &self.stop)?,
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

/// The granting end of virtual time.
#[derive(Debug)]
struct Leader {
    role: Role,
    followers: Vec<Link>,
    virtual_clock: VirtualClock,
    started: bool,
}

impl Leader {
    fn wait(&mut self, done: TurnResult, stop: &StopFlag) -> Result<Option<Time>, BusError> {
        if self.started {
            self.virtual_clock.done(self.role, done);
        } else {
            // Time stands still until everybody is there.
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
            let Some(answer) = link.grant(now, stop)? else {
                return Ok(None);
            };
            self.virtual_clock.done(role, answer);
        }
        Ok(None)
    }
}

/// The leader's link to one follower.
#[derive(Debug)]
struct Link {
    role: Role,
    grants: Writer<TimeAdvanceV1>,
    answers: Reader<TurnDoneV1>,
    listener: Listener,
}

impl Link {
    fn new(bus: &Bus, role: Role) -> Result<Self, BusError> {
        Ok(Self {
            role,
            answers: bus.reader(&role.done())?,
            listener: bus.listener(&role.done())?,
            grants: bus.writer(&role.grant())?,
        })
    }

    /// Waits until the follower is there; `false` if asked to stop meanwhile.
    fn await_start(&mut self, stop: &StopFlag) -> Result<bool, BusError> {
        while !stop.is_set() {
            // A follower that joins after this call misses it, hence the repetition.
            self.send(Time::UNSET)?;
            self.listener.wait(None, START_POLL)?;
            if self.answers.latest()?.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Grants `now` and waits, as long as it takes, for the answer; `None` if asked to stop meanwhile.
    fn grant(&mut self, now: Time, stop: &StopFlag) -> Result<Option<TurnResult>, BusError> {
        let grant = self.send(now)?;
        while !stop.is_set() {
            self.listener.wait(None, STOP_CHECK)?;
            match self.answers.latest()? {
                Some((_, answer)) if answer.grant == grant => {
                    let next = answer.next.is_set().then_some(answer.next);
                    return Ok(Some(TurnResult { next, published: answer.published != 0 }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    fn send(&mut self, now: Time) -> Result<u64, BusError> {
        let sequence = self.grants.send(0, Stamps::default(), TimeAdvanceV1 { now })?;
        self.grants.notify()?;
        Ok(sequence)
    }
}

/// The granted end of virtual time.
#[derive(Debug)]
struct Follower {
    grants: Reader<TimeAdvanceV1>,
    listener: Listener,
    answers: Writer<TurnDoneV1>,
    granted: Option<u64>,
}

impl Follower {
    fn wait(&mut self, done: TurnResult, stop: &StopFlag) -> Result<Option<Time>, BusError> {
        if let Some(grant) = self.granted.take() {
            self.answer(grant, done)?;
        }
        while !stop.is_set() {
            match self.grants.latest()? {
                Some((header, grant)) if grant.now.is_set() => {
                    self.granted = Some(header.sequence);
                    return Ok(Some(grant.now));
                }
                Some((header, _)) => self.answer(header.sequence, done)?,
                None => self.listener.wait(None, STOP_CHECK)?,
            }
        }
        Ok(None)
    }

    fn answer(&mut self, grant: u64, done: TurnResult) -> Result<(), BusError> {
        let next = done.next.unwrap_or(Time::UNSET);
        let published = u8::from(done.published);
        self.answers.send(0, Stamps::default(), TurnDoneV1 { grant, next, published })?;
        self.answers.notify()
    }
}
