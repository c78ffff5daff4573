//! Vehicle to host: acknowledgements and telemetry.

use super::{Descriptor, crc16};

/// The longest telemetry frame: that of `IMU_CALCDATA` \[bytes\].
pub const MAX_TELEMETRY: usize = 103;

pub(super) const HEAD: &[u8] = b">*>";
const TAIL: &[u8] = b"<#<";
/// Bytes of a frame besides its payload.
pub(super) const ENVELOPE: usize = 11;
/// Bytes before the payload.
pub(super) const PREFIX: usize = 6;
pub(super) const ACKNOWLEDGEMENT_LEN: usize = 5;

/// Why bytes are no frame to a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TelemetryError {
    /// Wrong number of bytes.
    #[error("{found} bytes, want {wanted}")]
    Length {
        /// Bytes found.
        found: usize,
        /// Bytes that such a frame has.
        wanted: usize,
    },
    /// Does not begin or end like one.
    #[error("wrong head or end")]
    Mark,
    /// Of unknown kind.
    #[error("unknown descriptor {0:#04x}")]
    Descriptor(u8),
    /// The CRC of the payload disagrees with it.
    #[error("CRC {found:#06x}, want {wanted:#06x}")]
    Crc {
        /// CRC found.
        found: u16,
        /// CRC of the payload found.
        wanted: u16,
    },
}

/// Bytes that are telemetry.
#[derive(Clone, Copy, Debug)]
pub struct TelemetryPacket<'a> {
    descriptor: Descriptor,
    payload: &'a [u8],
}

impl<'a> TelemetryPacket<'a> {
    /// Checks marks, descriptor, length and CRC.
    ///
    /// # Errors
    /// What is wrong.
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

    /// What it is about.
    #[must_use]
    pub fn descriptor(&self) -> Descriptor {
        self.descriptor
    }

    /// Its payload, of the length that belongs to the descriptor.
    #[must_use]
    pub fn payload(&self) -> &'a [u8] {
        self.payload
    }
}

/// Writes the telemetry frame of `payload` to the front of `out`; its length \[bytes\]. None if the payload has not the length
/// that belongs to the descriptor, or `out` has no room.
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

/// Bytes that are an acknowledgement.
///
/// It has no checksum; only what is acknowledged here, the command, is believed.
#[derive(Clone, Copy, Debug)]
pub struct AcknowledgementPacket(Descriptor);

impl AcknowledgementPacket {
    /// Checks length, marks and descriptor.
    ///
    /// # Errors
    /// What is wrong.
    pub fn new_checked(bytes: &[u8]) -> Result<Self, TelemetryError> {
        match *bytes {
            [b'>', b'a', number, b'a', b'<'] => match Descriptor::from_wire(number) {
                Some(descriptor @ Descriptor::ControlInput) => Ok(Self(descriptor)),
                _ => Err(TelemetryError::Descriptor(number)),
            },
            [_, _, _, _, _] => Err(TelemetryError::Mark),
            _ => Err(TelemetryError::Length { found: bytes.len(), wanted: ACKNOWLEDGEMENT_LEN }),
        }
    }

    /// What is acknowledged.
    #[must_use]
    pub fn descriptor(&self) -> Descriptor {
        self.0
    }
}

/// The frame that acknowledges a packet of this kind.
#[must_use]
pub fn acknowledgement_frame(descriptor: Descriptor) -> [u8; ACKNOWLEDGEMENT_LEN] {
    [b'>', b'a', descriptor as u8, b'a', b'<']
}
