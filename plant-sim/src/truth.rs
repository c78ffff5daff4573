//! Ports of a vehicle that is not commanded over the bus: it publishes the truth for the cameras, and its heartbeat.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, TruthV1};
use oqtal_bus::port::Writer;
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::ProcessContext;

/// Ports of a vehicle that is not commanded over the bus.
#[derive(Debug)]
pub(crate) struct TruthPorts {
    truths: Writer<TruthV1>,
    heartbeat: Heartbeat,
}

impl TruthPorts {
    /// Opens the ports. Like a real vehicle, the process has a separate configuration.
    ///
    /// # Errors
    /// The process is already running, or the bus refuses.
    pub(crate) fn open(context: &ProcessContext, bus: &Bus) -> Result<Self, BusError> {
        let truths = bus.writer(&TRUTH)?;
        let health = context.health.clone();
        let heartbeat = Heartbeat::new(bus, context.role, HealthV1::OWN_CONFIG, health)?;
        Ok(Self { truths, heartbeat })
    }

    /// Sends the heartbeat if it is due.
    ///
    /// # Errors
    /// The bus failed.
    pub(crate) fn beat(&mut self) -> Result<(), BusError> {
        self.heartbeat.beat(HealthV1::default())
    }

    /// Publishes a truth sample, and wakes the cameras if they capture it.
    ///
    /// # Errors
    /// The bus failed.
    pub(crate) fn publish(&mut self, truth: TruthV1) -> Result<(), BusError> {
        self.truths.send(truth.capture, Default::default(), truth)?;
        if truth.capture > 0 { self.truths.notify() } else { Ok(()) }
    }
}
