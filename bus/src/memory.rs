//! Topics inside one process and one thread, for flights in virtual time without inter-process communication.

use std::any::Any;
use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::rc::Rc;

use crate::error::BusError;
use crate::message::{Header, Message, Stamps};
use crate::topic::Topic;
use crate::transport::{Publish, Subscribe, Transport};

/// The samples that wait for one reader, at most `capacity`.
#[derive(Debug)]
struct Queue<M> {
    samples: VecDeque<(Header, M)>,
    capacity: usize,
}

/// The queues of all readers of one topic.
type Queues<M> = RefCell<Vec<Rc<RefCell<Queue<M>>>>>;

/// The topics of one simulated instance. Ports may be opened in any order; a reader sees what is sent after it was opened.
#[derive(Default)]
pub struct MemoryBus {
    topics: RefCell<HashMap<&'static str, Rc<dyn Any>>>,
}

impl fmt::Debug for MemoryBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MemoryBus").field("topics", &self.topics.borrow().len()).finish()
    }
}

impl MemoryBus {
    /// A bus without topics.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn queues<M: Message>(&self, topic: &Topic<M>) -> Rc<Queues<M>> {
        let mut topics = self.topics.borrow_mut();
        let queues = topics.entry(topic.name).or_insert_with(|| Rc::new(Queues::<M>::default()));
        Rc::clone(queues).downcast().expect("a topic's name determines its message type")
    }

    fn open_reader<M: Message>(&self, topic: &Topic<M>, capacity: usize) -> MemoryReader<M> {
        // Publishing to a reader, which keeps one sample, does not allocate.
        let samples = VecDeque::with_capacity(capacity.min(16));
        let queue = Rc::new(RefCell::new(Queue { samples, capacity }));
        self.queues(topic).borrow_mut().push(Rc::clone(&queue));
        MemoryReader { queue, last_sequence: 0, lost: 0 }
    }
}

impl Transport for MemoryBus {
    type Writer<M: Message> = MemoryWriter<M>;
    type Reader<M: Message> = MemoryReader<M>;

    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryWriter<M>, BusError> {
        Ok(MemoryWriter { queues: self.queues(topic), sequence: 0 })
    }

    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryReader<M>, BusError> {
        Ok(self.open_reader(topic, 1))
    }

    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<MemoryReader<M>, BusError> {
        Ok(self.open_reader(topic, topic.quality.buffer))
    }
}

/// The writing end of a topic in memory.
#[derive(Debug)]
pub struct MemoryWriter<M> {
    queues: Rc<Queues<M>>,
    sequence: u64,
}

impl<M: Message> Publish<M> for MemoryWriter<M> {
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError> {
        self.sequence += 1;
        let sequence = self.sequence;
        let header = Header { sequence, pose_sequence, schema: M::SCHEMA, source: 0, stamps };
        for queue in self.queues.borrow().iter() {
            let mut queue = queue.borrow_mut();
            // As on the bus, the newest samples win.
            if queue.samples.len() == queue.capacity {
                queue.samples.pop_front();
            }
            queue.samples.push_back((header, body));
        }
        Ok(sequence)
    }

    fn notify(&self) -> Result<(), BusError> {
        Ok(())
    }
}

/// The reading end of a topic in memory.
#[derive(Debug)]
pub struct MemoryReader<M> {
    queue: Rc<RefCell<Queue<M>>>,
    last_sequence: u64,
    lost: u64,
}

impl<M: Message> Subscribe<M> for MemoryReader<M> {
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let Some((header, body)) = self.queue.borrow_mut().samples.pop_front() else {
            return Ok(None);
        };
        if self.last_sequence > 0 {
            self.lost += header.sequence - self.last_sequence - 1;
        }
        self.last_sequence = header.sequence;
        Ok(Some((header, body)))
    }

    fn lost(&self) -> u64 {
        self.lost
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
