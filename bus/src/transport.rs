//! Interface of the ports of topics. Implementations: between processes ([`crate::bus::Bus`]) and inside one process
//! ([`crate::memory::MemoryBus`]).

use crate::error::BusError;
use crate::message::{Header, Message, Stamps};
use crate::stop::StopSwitch;
use crate::topic::Topic;

/// The writing end of a topic.
pub trait Publish<M: Message> {
    /// Publishes `body` about the pose `pose_sequence` and returns the sequence number it got. Wakes no process.
    ///
    /// # Errors
    /// The transport failed.
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError>;

    /// Wakes the processes that listen to this topic.
    ///
    /// # Errors
    /// The transport failed.
    fn notify(&self) -> Result<(), BusError>;

    /// Executes the path of [`Publish::send`] up to the sending, so that it is in the caches when it is needed.
    fn warm_up(&self) {}
}

/// The reading end of a topic.
pub trait Subscribe<M: Message> {
    /// Returns the next sample, oldest first; `None` when there is none.
    ///
    /// # Errors
    /// The writer has a different message schema, or the transport failed.
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError>;

    /// Samples missed so far, by the gaps in their sequence numbers.
    fn lost(&self) -> u64;

    /// Passes every waiting sample to `use_sample`, oldest first, with the number of samples lost so far \[-\].
    ///
    /// # Errors
    /// As [`Subscribe::receive`].
    fn drain(&mut self, mut use_sample: impl FnMut(u64, &Header, &M)) -> Result<(), BusError> {
        while let Some((header, body)) = self.receive()? {
            use_sample(self.lost(), &header, &body);
        }
        Ok(())
    }

    /// Returns the newest sample and discards older ones; `None` when none arrived since the last call.
    ///
    /// # Errors
    /// As [`Subscribe::receive`].
    fn latest(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let mut newest = None;
        while let Some(sample) = self.receive()? {
            newest = Some(sample);
        }
        Ok(newest)
    }
}

/// Opens the ports of one instance.
pub trait Transport {
    /// A writing end.
    type Writer<M: Message>: Publish<M> + std::fmt::Debug;
    /// A reading end.
    type Reader<M: Message>: Subscribe<M> + std::fmt::Debug;

    /// Opens the one writer of a topic.
    ///
    /// # Errors
    /// The topic has a writer already, or has a different message schema.
    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Writer<M>, BusError>;

    /// Opens a reader that keeps the newest sample only, for a control loop.
    ///
    /// # Errors
    /// The topic has a different message schema, or the transport failed.
    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError>;

    /// Opens the operator's stop.
    ///
    /// # Errors
    /// There is no memory, or the transport failed.
    fn stop_switch(&self) -> Result<StopSwitch, BusError>;

    /// Whether readers of `topic` may pass on other messages than were sent, as with a fault by hand.
    fn alters<M: Message>(&self, _topic: &Topic<M>) -> bool {
        false
    }

    /// Opens a reader that keeps as many samples as the topic allows, for an observer that must not miss one.
    ///
    /// # Errors
    /// The topic has a different message schema, or the transport failed.
    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError>;
}
