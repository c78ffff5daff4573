//! Messages as bytes: number, length, content.

use std::fmt;
use std::str::FromStr;

use crate::bytes::{ByteOrder, ByteReader, ByteWriter};

/// Version of the protocol, which decides how models and frames are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NatNetVersion {
    /// Major number \[-\].
    pub major: u8,
    /// Minor number \[-\].
    pub minor: u8,
}

impl NatNetVersion {
    /// Oldest supported version.
    pub const OLDEST: Self = Self::new(3, 0);
    /// Newest supported version: later ones have further sections in a frame, before its times.
    pub const NEWEST: Self = Self::new(4, 4);
    /// First version with names of markers in the models.
    pub const MARKER_NAMES: Self = Self::new(4, 0);
    /// First version in which every section of a frame states its length.
    pub const SIZED: Self = Self::new(4, 1);
    /// First version with attitudes in the models.
    pub const MODEL_ATTITUDES: Self = Self::new(4, 2);

    /// The version `major.minor`.
    pub const fn new(major: u8, minor: u8) -> Self {
        Self { major, minor }
    }

    /// Whether the version is supported.
    pub fn is_supported(self) -> bool {
        (Self::OLDEST..=Self::NEWEST).contains(&self)
    }
}

impl fmt::Display for NatNetVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

impl FromStr for NatNetVersion {
    type Err = NatNetError;

    fn from_str(text: &str) -> Result<Self, NatNetError> {
        let numbers = text
            .split_once('.')
            .and_then(|(major, minor)| Some(Self::new(major.parse().ok()?, minor.parse().ok()?)));
        numbers.ok_or(NatNetError::Content("version"))
    }
}

/// Error in a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NatNetError {
    /// Length field that does not agree with the datagram.
    #[error("a message does not have the length that it claims")]
    Length,
    /// Truncated or invalid content.
    #[error("{0} of the server cannot be read")]
    Content(&'static str),
}

/// Number of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageId {
    /// 0, of a client.
    Connect,
    /// 1, of a server.
    ServerInfo,
    /// 2, from a client: a request as text.
    Request,
    /// 3, of a server: its answer.
    Response,
    /// 4, of a client.
    RequestModels,
    /// 5, of a server.
    Models,
    /// 7, of a server.
    Frame,
    /// 9, of a client.
    Disconnect,
    /// 10, of a unicast client.
    KeepAlive,
    /// 12, from a client: its time, to be sent back.
    EchoRequest,
    /// 13, of a server: the time of the client, and that of the server.
    EchoResponse,
    /// 100, of a server: an unknown request.
    Unrecognized,
    /// Any other.
    Other(u16),
}

/// The numbers on the wire.
const IDS: [(u16, MessageId); 12] = [
    (0, MessageId::Connect),
    (1, MessageId::ServerInfo),
    (2, MessageId::Request),
    (3, MessageId::Response),
    (4, MessageId::RequestModels),
    (5, MessageId::Models),
    (7, MessageId::Frame),
    (9, MessageId::Disconnect),
    (10, MessageId::KeepAlive),
    (12, MessageId::EchoRequest),
    (13, MessageId::EchoResponse),
    (100, MessageId::Unrecognized),
];

impl MessageId {
    fn from_number(number: u16) -> Self {
        let known = IDS.iter().find(|(known, _)| *known == number);
        known.map_or(Self::Other(number), |(_, id)| *id)
    }

    fn number(self) -> u16 {
        match self {
            Self::Other(number) => number,
            known => IDS.iter().find(|(_, id)| *id == known).map_or(u16::MAX, |(n, _)| *n),
        }
    }
}

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NatNetMessage<'a> {
    /// Number.
    pub id: MessageId,
    /// Content.
    pub content: &'a [u8],
}

impl<'a> NatNetMessage<'a> {
    /// Parses a datagram.
    ///
    /// # Errors
    /// The datagram is shorter than it claims.
    pub fn parse(datagram: &'a [u8]) -> Result<Self, NatNetError> {
        let mut reader = ByteReader::new(datagram, ByteOrder::Little);
        let (Some(id), Some(length)) = (reader.u16(), reader.u16()) else {
            return Err(NatNetError::Length);
        };
        let content = reader.bytes(usize::from(length)).ok_or(NatNetError::Length)?;
        Ok(Self { id: MessageId::from_number(id), content })
    }
}

/// Appends a message to `out`; `write` writes its content, of at most 65535 bytes.
pub(super) fn write_content(
    out: &mut Vec<u8>,
    id: MessageId,
    write: impl FnOnce(&mut ByteWriter<'_>),
) {
    let start = out.len();
    let mut writer = ByteWriter::new(out, ByteOrder::Little);
    writer.u16(id.number()).u16(0);
    write(&mut writer);
    let length = u16::try_from(writer.len() - start - 4).unwrap_or(u16::MAX);
    out[start + 2..start + 4].copy_from_slice(&length.to_le_bytes());
}
