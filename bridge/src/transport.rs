//! Interface of transports, which pass frames between a protocol and a port: a bare stream of bytes, or packets. Pure: a transport wraps
//! and unwraps bytes, and states how long they take; [`crate::link`] reads and writes them. A transport is independent of format and
//! set-point.

use std::fmt::Debug;

use crate::protocol::{MAX_FRAME, VehicleFrame};

/// Bits of one byte on a serial line: start bit, eight data bits, stop bit (8N1).
const BITS_PER_BYTE: f64 = 10.0;

/// Carrier of frames. No method allocates, and no input makes one panic.
pub trait VehicleTransport: Debug + Send {
    /// Longest frame that is transported \[bytes\]: the greatest payload of a packet, or [`MAX_FRAME`] for a stream.
    fn max_frame(&self) -> usize;

    /// Bytes that are added to every frame, escapes not counted \[bytes\].
    fn overhead(&self) -> usize;

    /// Rate at which the port sends bytes one after another \[byte/s\]; `None` if a frame leaves the machine at once, as a
    /// datagram does.
    fn byte_rate(&self) -> Option<f64>;

    /// Wraps a frame for the port; empty if it is longer than [`VehicleTransport::max_frame`].
    fn wrap(&mut self, frame: &VehicleFrame) -> VehicleFrame;

    /// Unwraps what the port received, and passes each packet, or each piece of a stream, to `payload`.
    fn unwrap(&mut self, bytes: &[u8], payload: &mut dyn FnMut(&[u8]));

    /// Number of damaged packets received since the start.
    fn damaged(&self) -> u64;

    /// Discards partly received packets: a port was opened.
    fn reset(&mut self);

    /// Whether frames are sent as they are, also by another process.
    fn is_bare(&self) -> bool {
        false
    }
}

/// Rate of a serial port at `baud` \[byte/s\].
pub fn serial_byte_rate(baud: u32) -> f64 {
    f64::from(baud) / BITS_PER_BYTE
}

/// Frames without any wrapping: over a cable, a radio in transparent mode, or a network.
#[derive(Clone, Copy, Debug)]
pub struct BareTransport {
    byte_rate: Option<f64>,
}

impl BareTransport {
    /// Frames over a serial line at `baud`.
    pub fn serial(baud: u32) -> Self {
        Self { byte_rate: Some(serial_byte_rate(baud)) }
    }

    /// Frames that leave the machine at once.
    pub fn immediate() -> Self {
        Self { byte_rate: None }
    }
}

impl VehicleTransport for BareTransport {
    fn max_frame(&self) -> usize {
        MAX_FRAME
    }

    fn overhead(&self) -> usize {
        0
    }

    fn byte_rate(&self) -> Option<f64> {
        self.byte_rate
    }

    fn wrap(&mut self, frame: &VehicleFrame) -> VehicleFrame {
        *frame
    }

    fn unwrap(&mut self, bytes: &[u8], payload: &mut dyn FnMut(&[u8])) {
        payload(bytes);
    }

    fn damaged(&self) -> u64 {
        0
    }

    fn reset(&mut self) {}

    fn is_bare(&self) -> bool {
        true
    }
}
