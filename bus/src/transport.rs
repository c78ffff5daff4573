//! Interface of the ports of topics. Implementations: between processes ([`crate::bus::Bus`]) and inside one process
//! ([`crate::memory::MemoryBus`]).

use crate::error::BusError;
use crate::message::{CommandV1, Header, Message, Stamps};
use crate::stop::StopSwitch;
use crate::topic::Topic;

/// Writer of a topic.
pub trait Publish<M: Message> {
    /// Publishes `body` for the pose `pose_sequence` and returns its sequence number. Does not wake any process.
    ///
    /// # Errors
    /// The transport failed.
    fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError>;

    /// Wakes the processes that listen to this topic.
    ///
    /// # Errors
    /// The transport failed.
    fn notify(&self) -> Result<(), BusError>;

    /// Executes the code path of [`Publish::send`] without sending, so that it is in the caches when needed.
    fn warm_up(&self) {}
}

/// Path of commands to the vehicle besides the bus, without another process between.
pub trait DirectPath: std::fmt::Debug {
    /// Transmits the command that was published as `sequence`, if it can; otherwise the command is sent over the bus alone.
    fn transmit(&mut self, sequence: u64, command: &CommandV1);
}

/// Reader of a topic.
pub trait Subscribe<M: Message> {
    /// Returns the next sample, oldest first; `None` if there is none.
    ///
    /// # Errors
    /// The writer has a different message schema, or the transport failed.
    fn receive(&mut self) -> Result<Option<(Header, M)>, BusError>;

    /// Number of samples missed so far, from gaps in their sequence numbers.
    fn lost(&self) -> u64;

    /// Number of samples so far that an injected fault dropped or held back when they arrived.
    fn withheld(&self) -> u64 {
        0
    }

    /// Passes every waiting sample to `use_sample`, oldest first, with the number of samples lost so far \[-\].
    ///
    /// # Errors
    /// Like [`Subscribe::receive`].
    fn drain(&mut self, mut use_sample: impl FnMut(u64, &Header, &M)) -> Result<(), BusError> {
        while let Some((header, body)) = self.receive()? {
            use_sample(self.lost(), &header, &body);
        }
        Ok(())
    }

    /// Returns the newest sample and discards older ones; `None` if none arrived since the last call.
    ///
    /// # Errors
    /// Like [`Subscribe::receive`].
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
    /// Type of writers.
    type Writer<M: Message>: Publish<M> + std::fmt::Debug;
    /// Type of readers.
    type Reader<M: Message>: Subscribe<M> + std::fmt::Debug;

    /// Opens the only writer of a topic.
    ///
    /// # Errors
    /// The topic has a writer already, or has a different message schema.
    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Writer<M>, BusError>;

    /// Opens a reader that keeps only the newest sample, for a control loop.
    ///
    /// # Errors
    /// The topic has a different message schema, or the transport failed.
    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError>;

    /// Opens the operator's stop.
    ///
    /// # Errors
    /// Memory is exhausted, or the transport failed.
    fn stop_switch(&self) -> Result<StopSwitch, BusError>;

    /// Whether readers of `topic` may deliver altered messages, as with an injected fault.
    fn alters<M: Message>(&self, _topic: &Topic<M>) -> bool {
        false
    }

    /// Opens a reader with the topic's longest buffer, for an observer that must not miss a sample.
    ///
    /// # Errors
    /// The topic has a different message schema, or the transport failed.
    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError>;
}
