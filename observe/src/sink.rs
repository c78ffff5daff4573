//! Interface between the [`BusObserver`](crate::observer::BusObserver) and the receivers of its samples: the flight recorder, the
//! loop monitor, the model of an instance, the recording.

use oqtal_bus::message::Header;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{ObservedTopic, Sample};

/// Reception of a sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reception {
    /// Header of the sample, as sent by its writer.
    pub header: Header,
    /// Instant at which the observer received the sample, in the clock of the caller of
    /// [`BusObserver::poll`](crate::observer::BusObserver::poll).
    pub received_at: Time,
}

/// Receiver of the samples of observed topics.
pub trait Sink {
    /// Receives a sample.
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>);

    /// Receives the number of samples of `topic` that were overwritten before the observer polled \[-\]. Does nothing unless defined:
    /// the samples of a recording contain losses as events, and as gaps in their numbers.
    fn lost(&mut self, _topic: ObservedTopic, _count: u64) {}
}

/// Two sinks that both receive every sample, the first one first.
pub struct Tee<'a>(pub &'a mut dyn Sink, pub &'a mut dyn Sink);

impl Sink for Tee<'_> {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        self.0.sample(reception, sample);
        self.1.sample(reception, sample);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.0.lost(topic, count);
        self.1.lost(topic, count);
    }
}
