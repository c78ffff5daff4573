//! The health of a process: a record that its threads share, and the heartbeat on its health topic. The loop itself sends the
//! heartbeat, so that a hung loop sends none.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_bus::transport::{Publish, Transport};

/// The health record of a process, shared by its threads. Counting is wait-free.
#[derive(Clone, Debug, Default)]
pub struct Health(Arc<HealthRecord>);

#[derive(Debug, Default)]
struct HealthRecord {
    turns: AtomicU64,
    inputs: AtomicU64,
    status: Mutex<String>,
}

/// The health record at one instant.
#[derive(Clone, Debug, Default)]
pub(crate) struct HealthSample {
    /// Turns of the loop so far \[-\].
    pub turns: u64,
    /// Inputs received so far \[-\].
    pub inputs: u64,
    /// The status text; empty if the process sets none.
    pub status: String,
}

impl Health {
    /// Counts a turn of the loop.
    pub fn count_turn(&self) {
        self.0.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts an input: what the process waits for has arrived.
    pub fn count_input(&self) {
        self.0.inputs.fetch_add(1, Ordering::Relaxed);
    }

    /// Sets the status text. Takes a lock: not for a real-time loop.
    pub fn set_status(&self, status: impl Into<String>) {
        *self.0.status.lock().unwrap_or_else(PoisonError::into_inner) = status.into();
    }

    pub(crate) fn sample(&self) -> HealthSample {
        HealthSample {
            turns: self.0.turns.load(Ordering::Relaxed),
            inputs: self.0.inputs.load(Ordering::Relaxed),
            status: self.0.status.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

/// Time between two heartbeats without a change.
pub const HEALTH_PERIOD: Span = Span::from_millis(500);

/// Publishes the state of a process on its health topic.
#[derive(Debug)]
pub struct Heartbeat {
    writer: Writer<HealthV1>,
    config_hash: u64,
    last: HealthV1,
}

impl Heartbeat {
    /// The heartbeat of `role`, whose configuration has this hash.
    ///
    /// # Errors
    /// The process runs already, or the bus refuses.
    pub fn new(bus: &Bus, role: Role, config_hash: u64) -> Result<Self, BusError> {
        let writer = bus.writer(&role.health())?;
        Ok(Self { writer, config_hash, last: HealthV1::default() })
    }

    /// Publishes `health` once per [`HEALTH_PERIOD`] and on every change; fills in time and configuration hash. Reads the
    /// machine's clock also in virtual time, since observers of health wait in real time.
    ///
    /// # Errors
    /// The bus broke.
    pub fn beat(&mut self, health: HealthV1) -> Result<(), BusError> {
        let (now, config_hash) = (Time::now(), self.config_hash);
        let changed = self.last != HealthV1 { time: self.last.time, config_hash, ..health };
        if changed || now.since(self.last.time) >= HEALTH_PERIOD {
            self.last = HealthV1 { time: now, config_hash, ..health };
            self.writer.send(0, Stamps::default(), self.last)?;
        }
        Ok(())
    }
}
