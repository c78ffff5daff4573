//! The one observer of the bus: receives every sample of the chosen topics and hands it to a [`Sink`]. It publishes nothing.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{
    CommandV1, HealthV1, InputV1, Message, PoseV1, TelemetryV1, TruthV1, VehicleV1,
};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{
    COMMAND, INPUT, POSE, POSE_READ, Role, TELEMETRY, TRUTH, Topic, VEHICLE, VEHICLE_READ,
};
use oqtal_bus::transport::{Subscribe, Transport};

use crate::sink::{ObservedTopic, Reception, Sink};

/// Observes one instance over any transport: the processes' bus, or the in-memory bus of a flight in one process.
#[derive(Debug)]
pub struct BusObserver<T: Transport> {
    telemetry: Option<Port<T, TelemetryV1>>,
    truth: Option<Port<T, TruthV1>>,
    pose: Option<Port<T, PoseV1>>,
    command: Option<Port<T, CommandV1>>,
    vehicle: Option<Port<T, VehicleV1>>,
    input: Option<Port<T, InputV1>>,
    pose_read: Option<Port<T, PoseV1>>,
    vehicle_read: Option<Port<T, VehicleV1>>,
    health: Vec<(Role, Port<T, HealthV1>)>,
}

impl<T: Transport> BusObserver<T> {
    /// Opens a reader for each of `topics`, with the longest buffer that the topic allows.
    ///
    /// # Errors
    /// A topic has a different message schema, or the transport failed.
    pub fn open(bus: &T, topics: &[ObservedTopic]) -> Result<Self, BusError> {
        let mut observer = Self {
            telemetry: None,
            truth: None,
            pose: None,
            command: None,
            vehicle: None,
            input: None,
            pose_read: None,
            vehicle_read: None,
            health: Vec::new(),
        };
        for &topic in topics {
            observer.open_topic(bus, topic)?;
        }
        Ok(observer)
    }

    fn open_topic(&mut self, bus: &T, topic: ObservedTopic) -> Result<(), BusError> {
        use ObservedTopic as Of;
        match topic {
            Of::Truth => self.truth = Some(Port::open(bus, &TRUTH, topic)?),
            Of::Pose => self.pose = Some(Port::open(bus, &POSE, topic)?),
            Of::Command => self.command = Some(Port::open(bus, &COMMAND, topic)?),
            Of::Vehicle => self.vehicle = Some(Port::open(bus, &VEHICLE, topic)?),
            Of::Telemetry => self.telemetry = Some(Port::open(bus, &TELEMETRY, topic)?),
            Of::Input => self.input = Some(Port::open(bus, &INPUT, topic)?),
            Of::PoseRead => self.pose_read = Some(Port::open(bus, &POSE_READ, topic)?),
            Of::VehicleRead => self.vehicle_read = Some(Port::open(bus, &VEHICLE_READ, topic)?),
            Of::Health(role) => {
                self.health.push((role, Port::open(bus, &role.health(), topic)?));
            }
        }
        Ok(())
    }

    /// Hands every sample that arrived since the last call to `sink`, topic by topic and oldest first; `now` is the time of
    /// their reception.
    ///
    /// # Errors
    /// A topic has a different message schema, or the transport failed.
    pub fn poll(&mut self, now: Time, sink: &mut impl Sink) -> Result<(), BusError> {
        let Self {
            telemetry,
            truth,
            pose,
            command,
            vehicle,
            input,
            pose_read,
            vehicle_read,
            health,
        } = self;
        drain(telemetry, now, sink, Sink::telemetry)?;
        drain(truth, now, sink, Sink::truth)?;
        drain(pose, now, sink, Sink::pose)?;
        drain(command, now, sink, Sink::command)?;
        drain(vehicle, now, sink, Sink::vehicle)?;
        drain(pose_read, now, sink, Sink::pose_read)?;
        drain(vehicle_read, now, sink, Sink::vehicle_read)?;
        drain(input, now, sink, Sink::input)?;
        for (role, port) in health {
            port.drain(now, sink, |sink, reception, health| sink.health(reception, *role, health))?;
        }
        Ok(())
    }
}

/// Drains a port if it is open.
fn drain<T: Transport, M: Message, S: Sink>(
    port: &mut Option<Port<T, M>>,
    now: Time,
    sink: &mut S,
    callback: impl Fn(&mut S, &Reception, &M),
) -> Result<(), BusError> {
    port.as_mut().map_or(Ok(()), |port| port.drain(now, sink, callback))
}

/// The reader of one topic.
#[derive(Debug)]
struct Port<T: Transport, M: Message> {
    reader: T::Reader<M>,
    topic: ObservedTopic,
    /// Losses that the sink knows of.
    reported_lost: u64,
}

impl<T: Transport, M: Message> Port<T, M> {
    fn open(bus: &T, topic: &Topic<M>, observed: ObservedTopic) -> Result<Self, BusError> {
        Ok(Self { reader: bus.observer(topic)?, topic: observed, reported_lost: 0 })
    }

    fn drain<S: Sink>(
        &mut self,
        received_at: Time,
        sink: &mut S,
        callback: impl Fn(&mut S, &Reception, &M),
    ) -> Result<(), BusError> {
        let Self { reader, topic, reported_lost } = self;
        reader.drain(|lost, header, body| {
            if lost > *reported_lost {
                sink.lost(*topic, lost - *reported_lost);
                *reported_lost = lost;
            }
            callback(sink, &Reception { header: *header, received_at }, body);
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::memory::MemoryBus;
    use oqtal_bus::message::Stamps;
    use oqtal_bus::transport::Publish;

    /// Lists what it receives.
    #[derive(Default)]
    struct Listing(Vec<String>);

    impl Sink for Listing {
        fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
            let Reception { header, received_at } = reception;
            let (sequence, at) = (header.sequence, received_at.nanos());
            self.0.push(format!("pose {sequence} at {at}: z {}", pose.position[2]));
        }

        fn health(&mut self, _: &Reception, role: Role, _: &HealthV1) {
            self.0.push(format!("health of {}", role.name()));
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
        assert_eq!(listing.0, ["pose 1 at 7: z 1.5", "health of daemon"]);
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
