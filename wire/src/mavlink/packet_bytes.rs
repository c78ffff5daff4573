//! Bytes of one packet.

use std::fmt;

/// Longest packet, signed \[bytes\].
pub const MAX_PACKET: usize = 280;

/// Bytes of a packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct MavlinkWire {
    bytes: [u8; MAX_PACKET],
    length: usize,
}

impl MavlinkWire {
    /// Copy of `frame`; `None` if it is longer than any packet.
    pub(super) fn copy_of(frame: &[u8]) -> Option<Self> {
        let mut wire = Self { bytes: [0; MAX_PACKET], length: 0 };
        (frame.len() <= MAX_PACKET).then(|| {
            wire.append(frame);
            wire
        })
    }

    /// Appends bytes that fit.
    pub(super) fn append(&mut self, bytes: &[u8]) {
        self.bytes[self.length..][..bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl fmt::Debug for MavlinkWire {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("MavlinkWire(…)")
    }
}
