//! Whether a process is well: it says so twice a second and on every change, from its own loop, so that a loop that stands
//! still is silent.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_bus::transport::{Publish, Transport};

/// A process that is well is heard this often.
pub const HEALTH_PERIOD: Span = Span::from_millis(500);

/// Says that a process is well.
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

    /// Says `health` if it is time to, or if it changed; when and with which configuration is filled in. Reads the machine's
    /// clock: a person waits in real time, whatever clock drives the flight.
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
