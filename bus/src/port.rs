//! Ports of topics between processes: typed writers and readers over untyped ones.
//!
//! Per message type, only the encoding is compiled: all code of iceoryx2 is behind `RawWriter` and `RawReader` and is compiled
//! once.

use std::fmt;
use std::marker::PhantomData;

use crate::error::BusError;
use crate::message::{Header, Message, Stamps};
use crate::origin::Origin;
use crate::transport::{Publish, Subscribe};
use crate::wake::Notifier;

/// Writer of a topic for bytes.
pub(crate) trait RawWriter: fmt::Debug {
    /// Publishes `header` and a body of `size` bytes, which `fill` writes in place.
    fn send(
        &self,
        header: Header,
        size: usize,
        fill: &mut dyn FnMut(&mut [u8]),
    ) -> Result<(), BusError>;

    /// Executes the code path of `send` without sending.
    fn warm_up(&self, size: usize);
}

/// Reader of a topic for bytes.
pub(crate) trait RawReader: fmt::Debug {
    /// Passes the next message to `take`; false if there is none.
    fn receive(&self, take: &mut dyn FnMut(&Header, &[u8])) -> Result<bool, BusError>;
}

/// Writer of a topic.
#[derive(Debug)]
pub struct Writer<M: Message> {
    raw: Box<dyn RawWriter>,
    notifier: Notifier,
    source: u64,
    sequence: u64,
    message: PhantomData<M>,
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(raw: Box<dyn RawWriter>, notifier: Notifier) -> Self {
        let source = Origin::own().bits();
        Self { raw, notifier, source, sequence: 0, message: PhantomData }
    }
}

impl<M: Message> Publish<M> for Writer<M> {
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError> {
        let sequence = self.sequence + 1;
        let header =
            Header { sequence, pose_sequence, schema: M::SCHEMA, source: self.source, stamps };
        self.raw.send(header, M::SIZE, &mut |bytes| body.encode(bytes))?;
        self.sequence = sequence;
        Ok(sequence)
    }

    fn notify(&self) -> Result<(), BusError> {
        self.notifier.notify()
    }

    fn warm_up(&self) {
        self.raw.warm_up(M::SIZE);
    }
}

/// Reader of a topic.
#[derive(Debug)]
pub struct Reader<M: Message> {
    raw: Box<dyn RawReader>,
    topic: &'static str,
    last_sequence: u64,
    lost: u64,
    message: PhantomData<M>,
}

impl<M: Message> Reader<M> {
    pub(crate) fn new(raw: Box<dyn RawReader>, topic: &'static str) -> Self {
        Self { raw, topic, last_sequence: 0, lost: 0, message: PhantomData }
    }

    fn count(&mut self, sequence: u64) {
        // A restarted writer counts from 1 again, which is not a loss.
        if self.last_sequence > 0 && sequence > self.last_sequence {
            self.lost += sequence - self.last_sequence - 1;
        }
        self.last_sequence = sequence;
    }
}

impl<M: Message> Subscribe<M> for Reader<M> {
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let mut received = None;
        let is_there = self.raw.receive(&mut |header, bytes| {
            if header.schema == M::SCHEMA && bytes.len() == M::SIZE {
                received = Some((*header, M::decode(bytes)));
            }
        })?;
        let Some((header, body)) = received else {
            return if is_there {
                Err(BusError::Version { topic: self.topic.to_owned() })
            } else {
                Ok(None)
            };
        };
        self.count(header.sequence);
        Ok(Some((header, body)))
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}
