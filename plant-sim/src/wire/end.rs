//! The two halves of an emulated vehicle at the other end of a wire: the port, and the vehicle.

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::Failure;

use super::radio::Traffic;
use crate::disturbance::SceneDisturbance;
use crate::plant::PlantOutput;

/// Port at which a host finds the vehicle.
pub trait VehiclePort {
    /// Waits until bytes arrive, if it is to `listen`, or until this instant.
    ///
    /// # Errors
    /// The port broke.
    fn wait(&self, until: Time, listen: bool) -> Result<(), Failure>;

    /// Reads what has arrived, or one packet, into `buffer`; 0 for nothing.
    ///
    /// # Errors
    /// The port broke.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure>;

    /// Writes bytes, or one packet; what the port does not take is lost.
    ///
    /// # Errors
    /// The port broke.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure>;

    /// Does from time to time what the port needs.
    fn maintain(&mut self) {}
}

/// Traffic of a wire.
#[derive(Clone, Copy, Debug, Default)]
pub struct WireCounters {
    /// Frames that the vehicle read \[-\].
    pub read: u64,
    /// Damaged frames \[-\].
    pub damaged: u64,
    /// From the host.
    pub up: Traffic,
    /// To the host.
    pub down: Traffic,
}

/// Emulated vehicle behind its radio: bytes, or packets, in and out.
pub trait EmulatedVehicle {
    /// Instant of the next event.
    fn next_event(&self) -> Time;

    /// Whether the radio has room for what the host writes; otherwise the host has to wait.
    fn has_room(&self, now: Time) -> bool;

    /// Disturbs vehicle and radio from now on.
    fn disturb(&mut self, disturbance: SceneDisturbance);

    /// Skips what a pause of the process that ends at `now` has too much; returns it.
    fn skip_pause(&mut self, now: Time) -> Span;

    /// Takes bytes that the host wrote together.
    fn host_writes(&mut self, now: Time, bytes: &[u8]);

    /// Flies on to `until`, and tells `out` what happens.
    fn advance(&mut self, until: Time, out: &mut dyn FnMut(PlantOutput));

    /// Passes what has arrived at the host by `now` to `packet`.
    fn host_reads(&mut self, now: Time, packet: &mut dyn FnMut(&[u8]));

    /// Traffic since the start.
    fn counters(&self) -> WireCounters;
}
