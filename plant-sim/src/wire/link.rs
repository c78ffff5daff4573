//! Link between host and vehicle: interface of the link models.

use oqtal_bus::time::Time;
use oqtal_runtime::faults::RadioDisturbance;

/// Direction of bytes through a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkDirection {
    /// Direction from the host to the vehicle.
    Up,
    /// Direction from the vehicle to the host.
    Down,
}

/// Traffic in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Frames sent \[-\].
    pub frames: u64,
    /// Frames lost \[-\].
    pub lost: u64,
    /// Bytes sent \[bytes\].
    pub bytes: u64,
    /// Wrong bits, including those in lost frames \[bits\].
    pub wrong_bits: u64,
}

/// Model of a link.
pub trait LinkModel {
    /// Disturbs both directions from now on: a longer latency, further losses.
    fn disturb(&mut self, disturbance: RadioDisturbance);

    /// Sends bytes as one frame at `now`.
    fn send(&mut self, direction: LinkDirection, now: Time, bytes: &[u8]);

    /// Appends the bytes that have arrived by `now`, or the next packet, to `out`; returns whether anything was appended.
    fn receive(&mut self, direction: LinkDirection, now: Time, out: &mut Vec<u8>) -> bool;

    /// Instant at which the next frame in this direction has arrived completely.
    fn next_arrival(&self, direction: LinkDirection) -> Option<Time>;

    /// Whether the send queue is below its high-water mark; otherwise the sender should wait.
    fn has_room(&self, _direction: LinkDirection, _now: Time) -> bool {
        true
    }

    /// Traffic in this direction since the start.
    fn traffic(&self, direction: LinkDirection) -> Traffic;
}
