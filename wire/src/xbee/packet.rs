//! API frames as bytes: start, length, checksum, escapes.

use crate::bytes::ByteArray;

/// First byte of every API frame \[-\].
pub const START: u8 = 0x7E;
/// Byte that precedes an escaped byte in API mode 2.
pub(super) const ESCAPE: u8 = 0x7D;
/// Mask by which an escaped byte is changed (XOR).
const FLIP: u8 = 0x20;
/// XON and XOFF, which a serial port with software flow control removes from the stream.
const FLOW_CONTROL: [u8; 2] = [0x11, 0x13];

/// Greatest payload of a radio packet \[bytes\].
pub const MAX_PAYLOAD: usize = 100;
/// Greatest content between length and checksum \[bytes\]: a TX request of the greatest payload.
pub(super) const MAX_DATA: usize = 14 + MAX_PAYLOAD;
/// Greatest frame without escapes \[bytes\]: start, length, data, checksum.
pub(super) const MAX_PLAIN: usize = 1 + 2 + MAX_DATA + 1;
/// Greatest frame on the serial port \[bytes\]: every byte after the first escaped.
pub const MAX_WIRE: usize = 1 + 2 * (MAX_PLAIN - 1);

const _: () = assert!(MAX_WIRE <= crate::stream::MAX_FRAME);

/// Error in bytes that should be an API frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// Number of bytes that does not agree with the length field, or a length that no supported frame has.
    #[error("{0} bytes do not agree with the length field")]
    Length(usize),
    /// First byte other than [`START`].
    #[error("no start byte")]
    Start,
    /// Data and checksum that do not add up to 0xFF.
    #[error("data and checksum add up to {0:#04x}, expected 0xff")]
    Checksum(u8),
}

/// Checked view of an API frame without escapes.
#[derive(Clone, Copy, Debug)]
pub struct ApiPacket<'a> {
    kind: u8,
    body: &'a [u8],
}

impl<'a> ApiPacket<'a> {
    /// Checks start, length and checksum.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn new_checked(bytes: &'a [u8]) -> Result<Self, PacketError> {
        let &[start, high, low, ref rest @ ..] = bytes else {
            return Err(PacketError::Length(bytes.len()));
        };
        if start != START {
            return Err(PacketError::Start);
        }
        let length = usize::from(u16::from_be_bytes([high, low]));
        let [kind, body @ .., _checksum] = rest else {
            return Err(PacketError::Length(bytes.len()));
        };
        if length > MAX_DATA || rest.len() != length + 1 {
            return Err(PacketError::Length(bytes.len()));
        }
        match sum(rest) {
            0xFF => Ok(Self { kind: *kind, body }),
            other => Err(PacketError::Checksum(other)),
        }
    }

    /// Kind of frame \[-\].
    pub fn kind(&self) -> u8 {
        self.kind
    }

    /// Bytes after the kind.
    pub fn body(&self) -> &'a [u8] {
        self.body
    }
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Bytes for the serial port.
pub type WireBytes = ByteArray<MAX_WIRE>;

/// Frame of `data`: start, length, data, checksum, `escaped` or not.
pub(super) fn framed(data: &[u8], escaped: bool) -> WireBytes {
    let mut wire = WireBytes::EMPTY;
    wire.put(&[START]);
    let length = (data.len() as u16).to_be_bytes();
    let checksum = [!sum(data)];
    for byte in length.iter().chain(data).chain(&checksum) {
        if escaped && is_special(*byte) {
            wire.put(&[ESCAPE, byte ^ FLIP]);
        } else {
            wire.put(&[*byte]);
        }
    }
    wire
}

fn is_special(byte: u8) -> bool {
    byte == START || byte == ESCAPE || FLOW_CONTROL.contains(&byte)
}

/// Frame of API mode 2 without its escapes.
pub(super) struct Unescaped {
    plain: ByteArray<MAX_PLAIN>,
    /// Number of bytes read, escapes included \[bytes\].
    pub(super) read: usize,
}

/// Error: a special byte without an escape, or an escape of another byte.
pub(super) struct BadEscape;

impl Unescaped {
    /// Removes escapes from `bytes` until `wanted` bytes are read, or `bytes` end.
    pub(super) fn read(bytes: &[u8], wanted: usize) -> Result<Self, BadEscape> {
        let (mut plain, mut read) = (ByteArray::EMPTY, 0);
        while plain.len() < wanted.min(MAX_PLAIN) {
            let byte = match bytes[read..] {
                [first, ..] if read == 0 => first,
                [] | [ESCAPE] => break,
                [ESCAPE, escaped, ..] if is_special(escaped ^ FLIP) => {
                    read += 1;
                    escaped ^ FLIP
                }
                [byte, ..] if is_special(byte) => return Err(BadEscape),
                [byte, ..] => byte,
            };
            read += 1;
            plain.put(&[byte]);
        }
        Ok(Self { plain, read })
    }

    pub(super) fn as_bytes(&self) -> &[u8] {
        self.plain.as_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_error_in_a_frame_is_reported() {
        let frame = framed(&[0x8A, 0x06], false);
        let mut bytes = frame.as_bytes().to_vec();
        assert_eq!(ApiPacket::new_checked(&bytes).map(|packet| packet.kind()), Ok(0x8A));
        assert_eq!(ApiPacket::new_checked(&bytes[..5]).unwrap_err(), PacketError::Length(5));
        assert_eq!(ApiPacket::new_checked(&[]).unwrap_err(), PacketError::Length(0));
        bytes[4] ^= 1;
        assert_eq!(ApiPacket::new_checked(&bytes).unwrap_err(), PacketError::Checksum(0));
        bytes[0] = 0;
        assert_eq!(ApiPacket::new_checked(&bytes).unwrap_err(), PacketError::Start);
    }
}
