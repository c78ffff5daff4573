//! Observer of an instance for as long as its processes come and go, also after the loss of its files.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};

use crate::observer::BusObserver;
use crate::sink::{Reception, Sink};

/// Time without a sample after which files are checked: longer than the period of health messages, so that processes that still fly
/// with lost files are observed until they end.
const SILENT: Span = Span::from_millis(1500);

/// Observer of the instance at its paths. It joins the present run of the instance, and the next one once the files of this run were
/// removed and its processes have ended.
#[derive(Debug)]
pub struct InstanceObserver {
    paths: InstancePaths,
    topics: Vec<ObservedTopic>,
    /// Ports of the present run; `None` only while another run is joined.
    ports: Option<(BusObserver, Bus)>,
    received_at: Time,
}

impl InstanceObserver {
    /// Joins the instance at `paths`, and opens a reader for each of `topics`.
    ///
    /// # Errors
    /// Like [`Bus::open`] and [`BusObserver::open`].
    pub fn open(paths: &InstancePaths, topics: &[ObservedTopic]) -> Result<Self, BusError> {
        let topics = topics.to_vec();
        let (paths, ports, received_at) = (paths.clone(), None, Time::now());
        let mut observer = Self { paths, topics, ports, received_at };
        observer.join()?;
        Ok(observer)
    }

    /// The bus of the present run.
    pub fn bus(&self) -> &Bus {
        &self.ports.as_ref().expect("only a call of `join` closes the ports").1
    }

    /// Passes every sample that arrived since the last call to `sink`, as [`BusObserver::poll`].
    ///
    /// # Errors
    /// Like [`InstanceObserver::open`].
    pub fn poll(&mut self, now: Time, sink: &mut dyn Sink) -> Result<(), BusError> {
        let mut counting = CountingSink { sink, has_received: false };
        if let Some((observer, _)) = &mut self.ports {
            observer.poll(now, &mut counting)?;
        }
        if counting.has_received {
            self.received_at = now;
        } else if now.since(self.received_at) > SILENT {
            self.received_at = now;
            if self.bus().is_lost() {
                self.ports = None;
                self.join()?;
            }
        }
        Ok(())
    }

    fn join(&mut self) -> Result<(), BusError> {
        let bus = Bus::open(&self.paths)?.for_observer();
        self.ports = Some((BusObserver::open(&bus, &self.topics)?, bus));
        Ok(())
    }
}

/// A sink that records whether samples arrived.
struct CountingSink<'a> {
    sink: &'a mut dyn Sink,
    has_received: bool,
}

impl Sink for CountingSink<'_> {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        self.has_received = true;
        self.sink.sample(reception, sample);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.sink.lost(topic, count);
    }
}
