//! Topics inside one process and one thread, for flights in virtual time without inter-process communication.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::rc::Rc;
use std::sync::atomic::AtomicU32;

use crate::error::BusError;
use crate::message::{Header, Message, Stamps};
use crate::stop::{self, StopSwitch};
use crate::topic::Topic;
use crate::transport::{Publish, Subscribe, Transport};

/// Samples of one topic that a reader may still receive, shared by the topic's writer and readers.
#[derive(Debug)]
struct History<M> {
    samples: VecDeque<(Header, M)>,
    /// Samples sent before the first of `samples` \[-\].
    discarded: u64,
    cursors: Vec<Rc<Cursor>>,
    /// Number of writers opened so far \[-\]: a writer that replaces another one has another source.
    writers: u64,
}

/// Read position of a reader.
#[derive(Debug)]
struct Cursor {
    /// Number of the next sample to read, counted from 0 \[-\].
    next: Cell<u64>,
    /// Maximum number of samples waiting for the reader \[-\]; older ones are lost.
    capacity: u64,
}

impl Cursor {
    /// Number of the oldest sample that the reader has neither read nor lost after `sent` samples \[-\].
    fn oldest(&self, sent: u64) -> u64 {
        self.next.get().max(sent.saturating_sub(self.capacity))
    }
}

impl<M> History<M> {
    /// Samples sent so far \[-\].
    fn sent(&self) -> u64 {
        self.discarded + self.samples.len() as u64
    }

    /// Adds a sample, or only counts it if the topic has no reader. Samples that every reader has received or lost are discarded
    /// in bulk, when the memory is full.
    fn push(&mut self, header: Header, body: M) {
        if self.cursors.is_empty() {
            self.discarded += 1;
            return;
        }
        if self.samples.len() == self.samples.capacity() {
            let sent = self.sent() + 1;
            let oldest = self.cursors.iter().map(|cursor| cursor.oldest(sent)).min();
            let read = oldest.unwrap_or(sent).saturating_sub(self.discarded);
            let count = read.min(self.samples.len() as u64);
            self.samples.drain(..count as usize);
            self.discarded += count;
        }
        self.samples.push_back((header, body));
    }
}

/// History of a topic, shared by its ports.
type SharedHistory<M> = Rc<RefCell<History<M>>>;

/// Topics of one simulated instance. Ports may be opened in any order; a reader receives samples that are sent after it was
/// opened.
#[derive(Default)]
pub struct MemoryBus {
    topics: RefCell<HashMap<&'static str, Rc<dyn Any>>>,
    stop: Rc<[AtomicU32; stop::WORDS]>,
}

impl fmt::Debug for MemoryBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MemoryBus").field("topics", &self.topics.borrow().len()).finish()
    }
}

impl MemoryBus {
    /// A bus without topics.
    pub fn new() -> Self {
        Self::default()
    }

    fn history<M: Message>(&self, topic: &Topic<M>) -> SharedHistory<M> {
        let mut topics = self.topics.borrow_mut();
        let history = topics.entry(topic.name).or_insert_with(|| {
            // Capacity for readers of the newest sample: publishing to them does not allocate.
            let samples = VecDeque::with_capacity(1);
            Rc::new(RefCell::new(History::<M> {
                samples,
                discarded: 0,
                cursors: Vec::new(),
                writers: 0,
            }))
        });
        Rc::clone(history).downcast().expect("a topic's name determines its message type")
    }

    fn open_reader<M: Message>(&self, topic: &Topic<M>, capacity: usize) -> MemoryReader<M> {
        let history = self.history(topic);
        let next = Cell::new(history.borrow().sent());
        let cursor = Rc::new(Cursor { next, capacity: capacity as u64 });
        history.borrow_mut().cursors.push(Rc::clone(&cursor));
        MemoryReader { history, cursor, has_received: false, lost: 0 }
    }
}

impl Transport for MemoryBus {
    type Writer<M: Message> = MemoryWriter<M>;
    type Reader<M: Message> = MemoryReader<M>;

    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryWriter<M>, BusError> {
        let history = self.history(topic);
        let source = history.borrow().writers;
        history.borrow_mut().writers += 1;
        Ok(MemoryWriter { history, sequence: 0, source })
    }

    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryReader<M>, BusError> {
        Ok(self.open_reader(topic, 1))
    }

    fn stop_switch(&self) -> Result<StopSwitch, BusError> {
        Ok(StopSwitch::local(Rc::clone(&self.stop)))
    }

    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryReader<M>, BusError> {
        Ok(self.open_reader(topic, topic.quality.buffer))
    }
}

/// Writer of a topic in memory.
#[derive(Debug)]
pub struct MemoryWriter<M> {
    history: SharedHistory<M>,
    sequence: u64,
    source: u64,
}

impl<M: Message> MemoryWriter<M> {
    /// Sends a sample with the header of its recording.
    pub fn forward(&mut self, header: Header, body: M) {
        self.sequence = header.sequence;
        self.history.borrow_mut().push(header, body);
    }
}

impl<M: Message> Publish<M> for MemoryWriter<M> {
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError> {
        self.sequence += 1;
        let sequence = self.sequence;
        let source = self.source;
        let header = Header { sequence, pose_sequence, schema: M::SCHEMA, source, stamps };
        self.history.borrow_mut().push(header, body);
        Ok(sequence)
    }

    fn notify(&self) -> Result<(), BusError> {
        Ok(())
    }
}

/// Reader of a topic in memory.
#[derive(Debug)]
pub struct MemoryReader<M> {
    history: SharedHistory<M>,
    cursor: Rc<Cursor>,
    has_received: bool,
    lost: u64,
}

impl<M: Message> MemoryReader<M> {
    /// Advances to the oldest sample that is not lost; returns its number.
    fn skip_lost(&mut self) -> u64 {
        let (next, oldest) =
            (self.cursor.next.get(), self.cursor.oldest(self.history.borrow().sent()));
        // As on the bus, a loss is a gap behind a sample that was received.
        self.lost += if self.has_received { oldest - next } else { 0 };
        self.cursor.next.set(oldest);
        oldest
    }
}

impl<M: Message> Subscribe<M> for MemoryReader<M> {
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let next = self.skip_lost();
        let history = self.history.borrow();
        let sample = history.samples.get((next - history.discarded) as usize).copied();
        if sample.is_some() {
            self.cursor.next.set(next + 1);
            self.has_received = true;
        }
        Ok(sample)
    }

    fn drain(&mut self, mut use_sample: impl FnMut(u64, &Header, &M)) -> Result<(), BusError> {
        let next = self.skip_lost();
        let history = self.history.borrow();
        for (header, body) in history.samples.range((next - history.discarded) as usize..) {
            use_sample(self.lost, header, body);
            self.has_received = true;
        }
        self.cursor.next.set(history.sent());
        Ok(())
    }

    fn lost(&self) -> u64 {
        self.lost
    }

    fn latest(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let next = self.skip_lost();
        let history = self.history.borrow();
        let sent = history.sent();
        if next == sent {
            return Ok(None);
        }
        self.cursor.next.set(sent);
        self.has_received = true;
        Ok(history.samples.back().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::CommandV1;
    use crate::topic::COMMAND;

    #[test]
    fn a_reader_keeps_the_newest_sample_and_an_observer_all() {
        let bus = MemoryBus::new();
        let (mut reader, mut observer) =
            (bus.reader(&COMMAND).unwrap(), bus.observer(&COMMAND).unwrap());
        let mut writer = bus.writer(&COMMAND).unwrap();
        for thrust in [0.1, 0.2, 0.3] {
            let body = CommandV1 { thrust, ..CommandV1::default() };
            writer.send(7, Stamps::default(), body).unwrap();
        }
        let (header, body) = reader.receive().unwrap().unwrap();
        assert_eq!((header.sequence, header.pose_sequence, body.thrust), (3, 7, 0.3));
        assert_eq!(reader.receive().unwrap(), None);
        let seen: Vec<u64> =
            std::iter::from_fn(|| observer.receive().unwrap()).map(|(h, _)| h.sequence).collect();
        assert_eq!((seen, observer.lost()), (vec![1, 2, 3], 0));
    }

    #[test]
    fn the_latest_sample_is_the_newest_and_older_ones_are_not_lost() {
        let bus = MemoryBus::new();
        let mut observer = bus.observer(&COMMAND).unwrap();
        let mut writer = bus.writer(&COMMAND).unwrap();
        assert_eq!(observer.latest().unwrap(), None);
        for _ in 0..3 {
            writer.send(0, Stamps::default(), CommandV1::default()).unwrap();
        }
        let latest = observer.latest().unwrap().map(|(header, _)| header.sequence);
        assert_eq!((latest, observer.latest().unwrap(), observer.lost()), (Some(3), None, 0));
    }

    #[test]
    fn a_reader_receives_what_is_sent_after_it_was_opened() {
        let bus = MemoryBus::new();
        let mut writer = bus.writer(&COMMAND).unwrap();
        for _ in 0..9 {
            writer.send(0, Stamps::default(), CommandV1::default()).unwrap();
        }
        let mut reader = bus.reader(&COMMAND).unwrap();
        assert_eq!(reader.receive().unwrap(), None);
        writer.send(0, Stamps::default(), CommandV1::default()).unwrap();
        let received = reader.receive().unwrap().map(|(header, _)| header.sequence);
        assert_eq!((received, reader.lost()), (Some(10), 0));
    }

    #[test]
    fn overwritten_samples_are_counted_as_lost() {
        let bus = MemoryBus::new();
        let mut reader = bus.reader(&COMMAND).unwrap();
        let mut writer = bus.writer(&COMMAND).unwrap();
        for round in 0..3 {
            writer.send(0, Stamps::default(), CommandV1::default()).unwrap();
            writer.send(0, Stamps::default(), CommandV1::default()).unwrap();
            assert!(reader.receive().unwrap().is_some(), "round {round}");
        }
        assert_eq!(reader.lost(), 2);
    }
}
