//! Packets as bytes: size, type, content; and packets in a stream of bytes.

use super::data::{DataError, DataPacket};
use super::event::QtmEvent;
use crate::bytes::{ByteOrder, ByteReader, count_u32};

/// Length of the header: size and type \[bytes\].
const HEADER_BYTES: usize = 8;
/// Greatest packet that a client accepts \[bytes\].
pub const MAX_FROM_SERVER: usize = 1 << 20;
/// Greatest packet that a server accepts \[bytes\].
pub const MAX_FROM_CLIENT: usize = 1 << 16;

/// Error in bytes that should be a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QtmPacketError {
    /// Size field below the header, above the limit, or other than the number of bytes.
    #[error("a packet claims a size of {0} bytes")]
    Size(u32),
    /// Text that is not UTF-8.
    #[error("the text of a packet is not UTF-8")]
    Text,
    /// Event packet without its number.
    #[error("an event packet has no event")]
    Event,
    /// Error in a data packet.
    #[error(transparent)]
    Data(#[from] DataError),
}

/// A packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum QtmPacket<'a> {
    /// 0: the server refuses, with the reason.
    Error(&'a str),
    /// 1: a command to the server, or its answer.
    Command(&'a str),
    /// 2: parameters.
    Xml(&'a str),
    /// 3: a frame.
    Data(DataPacket<'a>),
    /// 4: there is no data: nothing is measured or played.
    NoMoreData,
    /// 6: an event.
    Event(QtmEvent),
    /// Any other type: C3D and QTM files.
    Other(u32),
}

impl<'a> QtmPacket<'a> {
    /// Parses one packet, which must be as long as `bytes`.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn parse(bytes: &'a [u8], order: ByteOrder) -> Result<Self, QtmPacketError> {
        let mut reader = ByteReader::new(bytes, order);
        let (Some(size), Some(kind)) = (reader.u32(), reader.u32()) else {
            return Err(QtmPacketError::Size(count_u32(bytes.len())));
        };
        if size as usize != bytes.len() {
            return Err(QtmPacketError::Size(size));
        }
        Ok(match kind {
            0 => Self::Error(text(reader.rest())?),
            1 => Self::Command(text(reader.rest())?),
            2 => Self::Xml(text(reader.rest())?),
            3 => Self::Data(DataPacket::parse(reader.rest(), order)?),
            4 => Self::NoMoreData,
            6 => Self::Event(QtmEvent::from_number(reader.u8().ok_or(QtmPacketError::Event)?)),
            other => Self::Other(other),
        })
    }
}

/// The text of a content, up to its first NUL.
fn text(content: &[u8]) -> Result<&str, QtmPacketError> {
    let end = content.iter().position(|byte| *byte == 0).unwrap_or(content.len());
    std::str::from_utf8(&content[..end]).map_err(|_| QtmPacketError::Text)
}

/// Packets in a stream of bytes. An error is final: the stream has lost its packet boundaries.
#[derive(Clone, Debug)]
pub struct QtmStream {
    order: ByteOrder,
    limit: usize,
    buffer: Vec<u8>,
    /// Bytes at the beginning of the buffer that are taken.
    taken: usize,
}

impl QtmStream {
    /// Stream of packets of at most `limit` bytes, with memory for one packet and the same number of bytes after it.
    pub fn new(order: ByteOrder, limit: usize) -> Self {
        Self { order, limit, buffer: Vec::with_capacity(2 * limit), taken: 0 }
    }

    /// Appends received bytes. Take all packets before the next bytes are appended: then no more than one packet and these bytes are
    /// held.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// The next complete packet; `None` if more bytes are needed.
    ///
    /// # Errors
    /// The stream does not consist of packets.
    pub fn take(&mut self) -> Result<Option<QtmPacket<'_>>, QtmPacketError> {
        let held = &self.buffer[self.taken..];
        let Some(size) = ByteReader::new(held, self.order).u32() else { return Ok(None) };
        if !(HEADER_BYTES..=self.limit).contains(&(size as usize)) {
            return Err(QtmPacketError::Size(size));
        }
        let Some(packet) = held.get(..size as usize) else { return Ok(None) };
        self.taken += packet.len();
        QtmPacket::parse(packet, self.order).map(Some)
    }

    /// Number of bytes held that belong to no complete packet yet \[bytes\].
    pub fn pending(&self) -> usize {
        self.buffer.len() - self.taken
    }
}
