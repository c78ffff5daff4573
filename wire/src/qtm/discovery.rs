//! Discovery of servers by broadcast.

use crate::bytes::{ByteOrder, ByteReader, ByteWriter, count_u32};

/// Port to which requests are sent \[-\].
pub const DISCOVERY_PORT: u16 = 22226;

/// Length of a request, its port included \[bytes\].
const REQUEST_BYTES: u32 = 10;

/// Request of a client: which servers are there?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiscoveryRequest {
    /// Port of the client for the replies \[-\].
    pub reply_port: u16,
}

impl DiscoveryRequest {
    /// Parses a datagram; `None` if it is not a request.
    pub fn parse(datagram: &[u8]) -> Option<Self> {
        let mut reader = ByteReader::new(datagram, ByteOrder::Little);
        let (_size, kind) = (reader.u32()?, reader.u32()?);
        let reply_port = u16::from_be_bytes(reader.take()?);
        (kind == 7 && reply_port > 0).then_some(Self { reply_port })
    }

    /// The datagram.
    pub fn to_datagram(self) -> Vec<u8> {
        let mut out = Vec::new();
        ByteWriter::new(&mut out, ByteOrder::Little).u32(REQUEST_BYTES).u32(7);
        out.extend_from_slice(&self.reply_port.to_be_bytes());
        out
    }
}

/// Reply of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiscoveryReply {
    /// Host, version and number of cameras, as `lab, QTM 2.17 (build 4000), 6 cameras`.
    pub description: String,
    /// First port of the server; the little-endian one is the next \[-\].
    pub base_port: u16,
}

impl DiscoveryReply {
    /// Parses a datagram; `None` if it is not a reply.
    pub fn parse(datagram: &[u8]) -> Option<Self> {
        let mut reader = ByteReader::new(datagram, ByteOrder::Little);
        let (_size, kind) = (reader.u32()?, reader.u32()?);
        let description = reader.text()?.to_owned();
        let base_port = u16::from_be_bytes(reader.take()?);
        (kind == 1).then_some(Self { description, base_port })
    }

    /// The datagram.
    pub fn to_datagram(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let mut writer = ByteWriter::new(&mut out, ByteOrder::Little);
        writer.u32(0).u32(1).text(&self.description).bytes(&self.base_port.to_be_bytes());
        let size = count_u32(writer.len());
        writer.set_u32(0, size);
        out
    }
}
