//! Writers and readers: iceoryx2 behind the few operations that the processes use.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;

use crate::error::{BusError, system};
use crate::message::{Header, Message, Stamps};
use crate::transport::{Publish, Subscribe};
use crate::wake::Notifier;

/// The writing end of a topic.
#[derive(Debug)]
pub struct Writer<M: Message> {
    publisher: Publisher<ipc::Service, M, Header>,
    bell: Notifier,
    topic: &'static str,
    source: u64,
    sequence: u64,
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(
        publisher: Publisher<ipc::Service, M, Header>,
        bell: Notifier,
        topic: &'static str,
    ) -> Self {
        Self { publisher, bell, topic, source: u64::from(std::process::id()), sequence: 0 }
    }
}

impl<M: Message> Publish<M> for Writer<M> {
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError> {
        let failed = |reason: &dyn std::fmt::Debug| {
            system(format!("publishing on `{}`", self.topic), reason)
        };
        let mut sample = self.publisher.loan_uninit().map_err(|e| failed(&e))?;
        let sequence = self.sequence + 1;
        *sample.user_header_mut() =
            Header { sequence, pose_sequence, schema: M::SCHEMA, source: self.source, stamps };
        sample.write_payload(body).send().map_err(|e| failed(&e))?;
        self.sequence = sequence;
        Ok(sequence)
    }

    fn notify(&self) -> Result<(), BusError> {
        self.bell.ring().map_err(|e| system(format!("notifying `{}`", self.topic), &e))
    }

    fn warm_up(&self) {
        drop(self.publisher.loan_uninit());
    }
}

/// The reading end of a topic.
#[derive(Debug)]
pub struct Reader<M: Message> {
    subscriber: Subscriber<ipc::Service, M, Header>,
    topic: &'static str,
    last_sequence: u64,
    lost: u64,
}

impl<M: Message> Reader<M> {
    pub(crate) fn new(
        subscriber: Subscriber<ipc::Service, M, Header>,
        topic: &'static str,
    ) -> Self {
        Self { subscriber, topic, last_sequence: 0, lost: 0 }
    }
}

impl<M: Message> Subscribe<M> for Reader<M> {
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let sample = self.subscriber.receive();
        let Some(sample) = sample.map_err(|e| system(format!("reading `{}`", self.topic), &e))?
        else {
            return Ok(None);
        };
        let header = *sample.user_header();
        if header.schema != M::SCHEMA {
            return Err(BusError::Version { topic: self.topic.to_owned() });
        }
        // A writer that restarted counts from 1 again; that is not a loss.
        if self.last_sequence > 0 && header.sequence > self.last_sequence {
            self.lost += header.sequence - self.last_sequence - 1;
        }
        self.last_sequence = header.sequence;
        Ok(Some((header, *sample.payload())))
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}
