//! Observer of the bus: receives every sample of the selected topics and passes it to a [`Sink`]. Publishes nothing.

use std::fmt;

use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{ObservedTopic, Sample, Topic, TopicVisitor};
use oqtal_bus::transport::{Subscribe, Transport};

use crate::sink::{Reception, Sink};

/// Passes the new samples of one topic, with their instant of reception, to a sink.
type Port = Box<dyn FnMut(Time, &mut dyn Sink) -> Result<(), BusError>>;

/// Observer of one instance over any transport: the bus between processes, or the in-memory bus of an in-process flight.
pub struct BusObserver(Vec<Port>);

impl BusObserver {
    /// Opens a reader for each of `topics`, with the longest buffer of the topic.
    ///
    /// # Errors
    /// A topic has a different message schema, or the transport failed.
    pub fn open<T: Transport + 'static>(
        bus: &T,
        topics: &[ObservedTopic],
    ) -> Result<Self, BusError> {
        let chosen = ObservedTopic::all().filter(|topic| topics.contains(topic));
        let ports = chosen.map(|observed| observed.visit(OpenPort { bus, observed }));
        ports.collect::<Result<_, _>>().map(Self)
    }

    /// Passes every sample that arrived since the last call to `sink`, topic by topic and oldest first; `now` is the instant of
    /// reception.
    ///
    /// # Errors
    /// A topic has a different message schema, or the transport failed.
    pub fn poll(&mut self, now: Time, sink: &mut dyn Sink) -> Result<(), BusError> {
        self.0.iter_mut().try_for_each(|port| port(now, sink))
    }
}

impl fmt::Debug for BusObserver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BusObserver").field("topics", &self.0.len()).finish()
    }
}

/// Opens the reader of a topic.
struct OpenPort<'a, T> {
    bus: &'a T,
    observed: ObservedTopic,
}

impl<T: Transport + 'static> TopicVisitor for OpenPort<'_, T> {
    type Output = Result<Port, BusError>;

    fn visit<M: Message>(
        self,
        topic: &Topic<M>,
        sample: impl for<'a> Fn(&'a M) -> Sample<'a> + 'static,
    ) -> Self::Output {
        let mut reader = self.bus.observer(topic)?;
        let (observed, mut reported_lost) = (self.observed, 0);
        Ok(Box::new(move |received_at, sink| {
            reader.drain(|lost, header, body| {
                if lost > reported_lost {
                    sink.lost(observed, lost - reported_lost);
                    reported_lost = lost;
                }
                sink.sample(&Reception { header: *header, received_at }, sample(body));
            })
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::memory::MemoryBus;
    use oqtal_bus::message::{CommandV1, HealthV1, PoseV1, Stamps};
    use oqtal_bus::topic::{COMMAND, POSE, Role};
    use oqtal_bus::transport::Publish;

    /// List of received samples.
    #[derive(Default)]
    struct Listing(Vec<String>);

    impl Sink for Listing {
        fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
            let Reception { header, received_at } = reception;
            let (sequence, at) = (header.sequence, received_at.nanos());
            self.0.push(match sample {
                Sample::Pose(pose) => {
                    format!("pose {sequence} at {at}: z {}", pose.position[2])
                }
                other => other.topic().to_string(),
            });
        }

        fn lost(&mut self, topic: ObservedTopic, count: u64) {
            self.0.push(format!("{count} of {topic} lost"));
        }
    }

    #[test]
    fn a_sink_gets_the_samples_of_the_topics_that_are_open() {
        let bus = MemoryBus::new();
        let topics = [ObservedTopic::Pose, ObservedTopic::Health(Role::Daemon)];
        let mut observer = BusObserver::open(&bus, &topics).unwrap();
        let mut poses = bus.writer(&POSE).unwrap();
        let mut commands = bus.writer(&COMMAND).unwrap();
        let mut health = bus.writer(&Role::Daemon.health()).unwrap();
        let pose = PoseV1 { position: [0.0, 0.0, 1.5], ..PoseV1::default() };
        health.send(0, Stamps::default(), HealthV1::default()).unwrap();
        commands.send(0, Stamps::default(), CommandV1::default()).unwrap();
        poses.send(0, Stamps::default(), pose).unwrap();
        let mut listing = Listing::default();
        observer.poll(Time::from_nanos(7), &mut listing).unwrap();
        assert_eq!(listing.0, ["pose 1 at 7: z 1.5", "health/daemon"]);
    }

    #[test]
    fn losses_are_reported_by_topic_before_the_sample_that_follows_them() {
        let bus = MemoryBus::new();
        let mut observer = BusObserver::open(&bus, &[ObservedTopic::Pose]).unwrap();
        let mut poses = bus.writer(&POSE).unwrap();
        let mut listing = Listing::default();
        poses.send(0, Stamps::default(), PoseV1::default()).unwrap();
        observer.poll(Time::from_nanos(1), &mut listing).unwrap();
        for _ in 0..POSE.quality.buffer + 3 {
            poses.send(0, Stamps::default(), PoseV1::default()).unwrap();
        }
        listing.0.clear();
        observer.poll(Time::from_nanos(2), &mut listing).unwrap();
        assert_eq!(listing.0.len(), POSE.quality.buffer + 1);
        assert_eq!(listing.0[..2], ["3 of pose lost", "pose 5 at 2: z 0"]);
    }
}
