//! Reader of a topic with faults.

use std::collections::VecDeque;
use std::rc::Rc;

use oqtal_bus::error::BusError;
use oqtal_bus::message::{Header, Message};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::{Fault, FaultKind};
use rand::RngExt;

use super::clock::FaultClock;
use super::corrupt::{add_noise, distort, falsify, garble};
use crate::random::{Generator, RandomSource, stream};

/// Maximum number of delayed samples; older ones are lost.
const MOST_DELAYED: usize = 1024;
/// Words of the random stream reserved for each fault.
const WORDS_PER_FAULT: u128 = 1 << 40;

/// A fault of this topic with its random numbers.
#[derive(Debug)]
struct ActiveFault<M> {
    fault: Fault,
    generator: Generator,
    /// Instant and content of the first sample on which it acts.
    first: Option<(Time, M)>,
    /// Instant at which a slow topic last delivered a sample.
    passed_at: Option<Time>,
}

impl<M: Message> ActiveFault<M> {
    /// Fault number `index` of the configuration.
    fn new(fault: &Fault, index: usize, seed: u64) -> Self {
        let mut generator = stream(seed, RandomSource::Fault);
        generator.set_word_pos(index as u128 * WORDS_PER_FAULT);
        Self { fault: fault.clone(), generator, first: None, passed_at: None }
    }

    /// Whether a sample that arrives at `now` is dropped.
    fn is_missing(&mut self, now: Time) -> bool {
        match self.fault.kind {
            FaultKind::Off => true,
            FaultKind::Intermittent => {
                let draw: f64 = self.generator.random();
                draw < self.fault.value() / 100.0
            }
            FaultKind::Slow => {
                let period = Span::from_seconds(1.0 / self.fault.value());
                let missing = self.passed_at.is_some_and(|passed| now.since(passed) < period);
                self.passed_at = if missing { self.passed_at } else { Some(now) };
                missing
            }
            _ => false,
        }
    }

    /// Alters the numbers of a sample taken at `now`.
    fn alter(&mut self, now: Time, body: &mut M, last: Option<M>) {
        let (since, first) = *self.first.get_or_insert((now, *body));
        match self.fault.kind {
            FaultKind::Stuck => *body = last.unwrap_or(*body),
            FaultKind::Garbage => garble(body, &mut self.generator),
            FaultKind::Wrong => falsify(body, &self.fault, &mut self.generator.clone()),
            FaultKind::FrozenNoise => {
                *body = last.unwrap_or(*body);
                add_noise(body, &self.fault, &mut self.generator);
            }
            FaultKind::Noise => add_noise(body, &self.fault, &mut self.generator),
            FaultKind::Drift | FaultKind::Mirror | FaultKind::Rotate => {
                let since_s = now.since(since).seconds();
                let generator = &mut self.generator.clone();
                distort(body, &self.fault, (&first, since_s), generator);
            }
            _ => {}
        }
    }

    /// Delay of a sample.
    fn delay(&self) -> Span {
        match self.fault.kind {
            FaultKind::Delayed => Span::from_seconds(self.fault.value() * 1e-3),
            _ => Span::ZERO,
        }
    }
}

/// Faults of one port, and the delayed samples.
#[derive(Debug)]
pub(super) struct Injector<T: Transport, M> {
    clock: Rc<FaultClock<T>>,
    faults: Vec<ActiveFault<M>>,
    port: usize,
    delayed: VecDeque<(Time, Header, M)>,
    /// Last value before it was altered by a fault.
    last: Option<M>,
    missing: u64,
    withheld: u64,
}

impl<T: Transport, M: Message> Injector<T, M> {
    /// Injector of `faults`, given with their indices in the configuration.
    pub(super) fn new(
        clock: &Rc<FaultClock<T>>,
        faults: &[(usize, &Fault)],
        seed: u64,
    ) -> Box<Self> {
        let faults = faults.iter().map(|&(index, fault)| ActiveFault::new(fault, index, seed));
        Box::new(Self {
            clock: Rc::clone(clock),
            faults: faults.collect(),
            port: clock.add_port(),
            delayed: VecDeque::with_capacity(MOST_DELAYED),
            last: None,
            missing: 0,
            withheld: 0,
        })
    }

    /// Takes the samples that have arrived, and returns the next one that is due.
    fn receive(&mut self, inner: &mut impl Subscribe<M>) -> Result<Option<(Header, M)>, BusError> {
        while let Some((header, body)) = inner.receive()? {
            self.take(header, body);
        }
        let now = self.clock.now();
        let due = self.delayed.front().is_some_and(|(due, ..)| *due <= now);
        let sample = if due { self.delayed.pop_front() } else { None };
        self.clock.set_due(self.port, self.delayed.front().map(|(due, ..)| *due));
        Ok(sample.map(|(_, header, body)| (header, body)))
    }

    /// Passes a sample through every active fault. Samples keep their order, also behind delayed ones.
    fn take(&mut self, header: Header, mut body: M) {
        let now = self.clock.now();
        let (mut delay, mut altered) = (Span::ZERO, false);
        for active in &mut self.faults {
            if !self.clock.acts(&active.fault) {
                continue;
            }
            if active.is_missing(now) {
                self.missing += 1;
                self.withheld += 1;
                return;
            }
            active.alter(now, &mut body, self.last);
            delay = delay + active.delay();
            altered = true;
        }
        self.last = if altered { self.last } else { Some(body) };
        let last_due = self.delayed.back().map_or(now, |(due, ..)| *due);
        if self.delayed.len() == MOST_DELAYED {
            self.delayed.pop_front();
            self.missing += 1;
        }
        let due = (now + delay).max(last_due);
        self.withheld += u64::from(due > now);
        self.delayed.push_back((due, header, body));
    }
}

/// Reader of a topic, with its faults, if any.
#[derive(Debug)]
pub struct FaultyReader<T: Transport, M: Message> {
    pub(super) inner: T::Reader<M>,
    pub(super) injector: Option<Box<Injector<T, M>>>,
}

impl<T: Transport + std::fmt::Debug, M: Message> Subscribe<M> for FaultyReader<T, M> {
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError> {
        match &mut self.injector {
            Some(injector) => injector.receive(&mut self.inner),
            None => self.inner.receive(),
        }
    }

    fn lost(&self) -> u64 {
        self.inner.lost() + self.injector.as_ref().map_or(0, |injector| injector.missing)
    }

    fn withheld(&self) -> u64 {
        self.injector.as_ref().map_or(0, |injector| injector.withheld)
    }

    fn latest(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let Some(injector) = &mut self.injector else { return self.inner.latest() };
        let mut newest = None;
        while let Some(sample) = injector.receive(&mut self.inner)? {
            newest = Some(sample);
        }
        Ok(newest)
    }

    fn drain(&mut self, mut use_sample: impl FnMut(u64, &Header, &M)) -> Result<(), BusError> {
        if self.injector.is_none() {
            return self.inner.drain(use_sample);
        }
        while let Some((header, body)) = self.receive()? {
            use_sample(self.lost(), &header, &body);
        }
        Ok(())
    }
}
