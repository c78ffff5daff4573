//! Messages as bytes, and messages in a stream of bytes.

use crate::bytes::{ByteOrder, ByteReader, ByteWriter, count_u32};

/// Length of the header \[bytes\].
const HEADER_BYTES: usize = 24;
/// Messages are padded to a multiple of this length \[bytes\].
const ALIGNMENT: usize = 8;
/// Greatest message that is accepted, without padding \[bytes\].
pub const MAX_MESSAGE_BYTES: usize = 1 << 16;

/// Error in a stream of messages: its boundaries are lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a message claims a length of {0} bytes")]
pub struct VrpnMessageError(pub u32);

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VrpnMessage<'a> {
    /// Time, whole seconds on the server's clock \[s\].
    pub seconds: u32,
    /// Time within the second \[us\].
    pub micros: u32,
    /// Number of the sender; in a description the number that is described \[-\].
    pub sender: i32,
    /// Number of the type; negative for types of the protocol itself \[-\].
    pub kind: i32,
    /// Payload.
    pub payload: &'a [u8],
}

impl<'a> VrpnMessage<'a> {
    /// Type of the description of a sender.
    pub const SENDER_DESCRIPTION: i32 = -1;
    /// Type of the description of a type.
    pub const TYPE_DESCRIPTION: i32 = -2;
    /// Type of the last message.
    pub const DISCONNECT: i32 = -5;

    /// A message without time and payload.
    pub fn new(sender: i32, kind: i32) -> Self {
        Self { seconds: 0, micros: 0, sender, kind, payload: &[] }
    }

    /// Time on the server's clock \[us\].
    pub fn time_us(&self) -> u64 {
        u64::from(self.seconds) * 1_000_000 + u64::from(self.micros)
    }

    /// The name in a description; `None` if the payload is not a name.
    pub fn described_name(&self) -> Option<&'a str> {
        let mut reader = ByteReader::new(self.payload, ByteOrder::Big);
        let length = reader.u32()? as usize;
        let text = reader.rest().get(..length)?;
        let end = text.iter().position(|byte| *byte == 0).unwrap_or(length);
        std::str::from_utf8(&text[..end]).ok()
    }

    fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut reader = ByteReader::new(bytes, ByteOrder::Big);
        let (_length, seconds, micros) = (reader.u32()?, reader.u32()?, reader.u32()?);
        let (sender, kind, _sequence) = (reader.i32()?, reader.i32()?, reader.u32()?);
        Some(Self { seconds, micros, sender, kind, payload: reader.rest() })
    }
}

/// Appends a message to `out`, with this sequence number.
pub fn write_message(out: &mut Vec<u8>, message: &VrpnMessage<'_>, sequence: u32) {
    let mut writer = ByteWriter::new(out, ByteOrder::Big);
    let length = HEADER_BYTES + message.payload.len();
    writer.u32(count_u32(length)).u32(message.seconds).u32(message.micros);
    writer.i32(message.sender).i32(message.kind).u32(sequence).bytes(message.payload);
    writer.bytes(&[0; ALIGNMENT][..padding(length)]);
}

/// Appends the description of the sender or type `number` to `out`: length of the name, its NUL included, and the name.
pub(super) fn write_description(
    out: &mut Vec<u8>,
    (number, kind): (i32, i32),
    name: &str,
    sequence: u32,
) {
    let start = out.len();
    let mut writer = ByteWriter::new(out, ByteOrder::Big);
    writer.u32(0).u32(0).u32(0).i32(number).i32(kind).u32(sequence);
    let payload = writer.len();
    writer.u32(0).text(name);
    let (length, name) = (writer.len() - start, writer.len() - payload - 4);
    writer.set_u32(start, count_u32(length));
    writer.set_u32(payload, count_u32(name));
    writer.bytes(&[0; ALIGNMENT][..padding(length)]);
}

fn padding(length: usize) -> usize {
    length.next_multiple_of(ALIGNMENT) - length
}

/// Messages in a stream of bytes. An error is final.
#[derive(Clone, Debug)]
pub struct VrpnStream {
    buffer: Vec<u8>,
    /// Bytes at the beginning of the buffer that are taken.
    taken: usize,
}

impl Default for VrpnStream {
    fn default() -> Self {
        Self::new()
    }
}

impl VrpnStream {
    /// Stream from its first byte on, with memory for the longest message and as many bytes behind it.
    pub fn new() -> Self {
        Self { buffer: Vec::with_capacity(2 * MAX_MESSAGE_BYTES), taken: 0 }
    }

    /// Appends received bytes. Take all messages before the next bytes are appended: then no more than one message and these bytes
    /// are held.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Takes `N` bytes outside messages: the cookie.
    pub fn take_bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let bytes = self.buffer[self.taken..].first_chunk::<N>().copied();
        self.taken += bytes.map_or(0, |_| N);
        bytes
    }

    /// The next complete message; `None` if more bytes are needed.
    ///
    /// # Errors
    /// The stream does not consist of messages.
    pub fn take(&mut self) -> Result<Option<VrpnMessage<'_>>, VrpnMessageError> {
        let held = &self.buffer[self.taken..];
        let Some(length) = ByteReader::new(held, ByteOrder::Big).u32() else { return Ok(None) };
        let bytes = length as usize;
        if !(HEADER_BYTES..=MAX_MESSAGE_BYTES).contains(&bytes) {
            return Err(VrpnMessageError(length));
        }
        let total = bytes + padding(bytes);
        let Some(message) = held.get(..total) else { return Ok(None) };
        self.taken += total;
        Ok(VrpnMessage::parse(&message[..bytes]))
    }
}
