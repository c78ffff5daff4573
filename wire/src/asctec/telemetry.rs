//! Frames from vehicle to host: acknowledgements and telemetry.

use super::{Descriptor, crc16};

/// Length of the longest telemetry frame, `IMU_CALCDATA` \[bytes\].
pub const MAX_TELEMETRY: usize = 103;

pub(super) const HEAD: &[u8] = b">*>";
const TAIL: &[u8] = b"<#<";
/// Length of a frame without its payload \[bytes\].
pub(super) const ENVELOPE: usize = 11;
/// Length of what precedes the payload \[bytes\].
pub(super) const PREFIX: usize = 6;
pub(super) const ACKNOWLEDGEMENT_LEN: usize = 5;

/// Error in bytes that should be a frame to a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TelemetryError {
    /// Wrong number of bytes.
    #[error("{found} bytes, expected {wanted}")]
    Length {
        /// Length found \[bytes\].
        found: usize,
        /// Length of such a frame \[bytes\].
        wanted: usize,
    },
    /// Wrong first or last bytes.
    #[error("wrong head or end")]
    Mark,
    /// Unknown descriptor.
    #[error("unknown descriptor {0:#04x}")]
    Descriptor(u8),
    /// CRC that does not agree with the payload.
    #[error("CRC {found:#06x}, expected {wanted:#06x}")]
    Crc {
        /// CRC found.
        found: u16,
        /// CRC of the payload found.
        wanted: u16,
    },
}

/// Checked view of a telemetry frame.
#[derive(Clone, Copy, Debug)]
pub struct TelemetryPacket<'a> {
    descriptor: Descriptor,
    payload: &'a [u8],
}

impl<'a> TelemetryPacket<'a> {
    /// Checks marks, descriptor, length and CRC.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn new_checked(bytes: &'a [u8]) -> Result<Self, TelemetryError> {
        let (head, tail) = (bytes.starts_with(HEAD), bytes.ends_with(TAIL));
        let &[_, _, _, low, high, number, ref rest @ ..] = bytes else {
            return Err(TelemetryError::Length { found: bytes.len(), wanted: ENVELOPE });
        };
        if !head || !tail {
            return Err(TelemetryError::Mark);
        }
        let descriptor = Descriptor::from_wire(number).ok_or(TelemetryError::Descriptor(number))?;
        let length = descriptor.payload_len();
        let (found, wanted) = (bytes.len(), length + ENVELOPE);
        if found != wanted || usize::from(u16::from_le_bytes([low, high])) != length {
            return Err(TelemetryError::Length { found, wanted });
        }
        let (payload, end) = rest.split_at(length);
        let (found, wanted) = (u16::from_le_bytes([end[0], end[1]]), crc16(payload));
        if found != wanted {
            return Err(TelemetryError::Crc { found, wanted });
        }
        Ok(Self { descriptor, payload })
    }

    /// The descriptor.
    pub fn descriptor(&self) -> Descriptor {
        self.descriptor
    }

    /// The payload, of the descriptor's length.
    pub fn payload(&self) -> &'a [u8] {
        self.payload
    }
}

/// Writes the telemetry frame of `payload` to the front of `out`; returns its length \[bytes\]. `None` if `payload` has not the
/// descriptor's length, or `out` has no room.
pub fn write_telemetry(descriptor: Descriptor, payload: &[u8], out: &mut [u8]) -> Option<usize> {
    let length = descriptor.payload_len();
    let frame = out.get_mut(..length + ENVELOPE)?;
    if payload.len() != length {
        return None;
    }
    let (prefix, rest) = frame.split_at_mut(PREFIX);
    let (body, suffix) = rest.split_at_mut(length);
    prefix[..3].copy_from_slice(HEAD);
    prefix[3..5].copy_from_slice(&(length as u16).to_le_bytes());
    prefix[5] = descriptor as u8;
    body.copy_from_slice(payload);
    suffix[..2].copy_from_slice(&crc16(payload).to_le_bytes());
    suffix[2..].copy_from_slice(TAIL);
    Some(length + ENVELOPE)
}

/// Decodes an acknowledgement: checks length, marks and descriptor; returns the kind of packet that is acknowledged. The frame has no
/// checksum: only acknowledgements of a command are accepted.
///
/// # Errors
/// The first check that fails.
pub fn read_acknowledgement(bytes: &[u8]) -> Result<Descriptor, TelemetryError> {
    match *bytes {
        [b'>', b'a', number, b'a', b'<'] => match Descriptor::from_wire(number) {
            Some(descriptor @ Descriptor::ControlInput) => Ok(descriptor),
            _ => Err(TelemetryError::Descriptor(number)),
        },
        [_, _, _, _, _] => Err(TelemetryError::Mark),
        _ => Err(TelemetryError::Length { found: bytes.len(), wanted: ACKNOWLEDGEMENT_LEN }),
    }
}

/// Encodes the acknowledgement of a packet of this kind.
pub fn acknowledgement_frame(descriptor: Descriptor) -> [u8; ACKNOWLEDGEMENT_LEN] {
    [b'>', b'a', descriptor as u8, b'a', b'<']
}
