//! Tables of contents: the vehicle numbers its parameters and its log variables, and a CRC identifies known tables.

use super::packet::{CrtpPacket, CrtpPort};
use crate::bytes::{ByteOrder, ByteReader};

/// Channel of tables.
const CHANNEL: u8 = 0;
/// Asks for an element, of up to 65536.
const ELEMENT: u8 = 2;
/// Asks for size and CRC.
const INFO: u8 = 3;

/// The two tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// Parameters.
    Parameters,
    /// Log variables.
    Logging,
}

impl TableKind {
    /// Port of the table.
    pub fn port(self) -> CrtpPort {
        match self {
            Self::Parameters => CrtpPort::Parameters,
            Self::Logging => CrtpPort::Logging,
        }
    }

    pub(super) fn info_request(self) -> CrtpPacket {
        CrtpPacket::new(self.port(), CHANNEL, &[INFO])
    }

    pub(super) fn element_request(self, id: u16) -> CrtpPacket {
        CrtpPacket::new(self.port(), CHANNEL, &[ELEMENT]).with(&id.to_le_bytes())
    }
}

/// Size and identity of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableInfo {
    /// Number of elements \[-\].
    pub count: u16,
    /// CRC over types and names of all elements \[-\].
    pub crc: u32,
}

/// CRC of the identity of a table.
const IDENTITY: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

impl TableInfo {
    /// Size and identity of the table of `elements`: any change of a type or a name changes the CRC.
    pub fn of<'a>(elements: impl Iterator<Item = TableElement<'a>>) -> Self {
        let (mut count, mut digest) = (0, IDENTITY.digest());
        for element in elements {
            count += 1;
            let TableElement { kind, group, name, .. } = element;
            let parts = [&[kind], group.as_bytes(), &[0], name.as_bytes(), &[0]];
            parts.into_iter().for_each(|part| digest.update(part));
        }
        Self { count, crc: digest.finalize() }
    }
}

/// Element of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableElement<'a> {
    /// Number of the element \[-\].
    pub id: u16,
    /// Type of the element, as [`super::ParameterType`] or [`super::LogType`] reads it \[-\].
    pub kind: u8,
    /// Name of its group.
    pub group: &'a str,
    /// Its name within the group.
    pub name: &'a str,
}

/// Message of a vehicle or a host about a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TableWord<'a> {
    /// Request for size and CRC.
    InfoRequest,
    /// Request for an element.
    ElementRequest(u16),
    /// Size and CRC.
    Info(TableInfo),
    /// An element.
    Element(TableElement<'a>),
    /// The requested element does not exist.
    NoElement,
}

impl<'a> TableWord<'a> {
    /// Reads what a host asks.
    pub(super) fn read_request(payload: &[u8]) -> Option<Self> {
        match payload {
            [INFO, ..] => Some(Self::InfoRequest),
            [ELEMENT, low, high, ..] => {
                Some(Self::ElementRequest(u16::from_le_bytes([*low, *high])))
            }
            _ => None,
        }
    }

    /// Reads what a vehicle answers.
    pub(super) fn read_reply(payload: &'a [u8]) -> Option<Self> {
        let mut fields = ByteReader::new(payload, ByteOrder::Little);
        match fields.u8()? {
            INFO => Some(Self::Info(TableInfo { count: fields.u16()?, crc: fields.u32()? })),
            ELEMENT if fields.rest().is_empty() => Some(Self::NoElement),
            ELEMENT => {
                let (id, kind) = (fields.u16()?, fields.u8()?);
                let group = fields.text()?;
                // The end of the second name is the end of the packet; some firmware ends it by a NUL as well.
                let name = fields.rest().split(|byte| *byte == 0).next().unwrap_or_default();
                let name = std::str::from_utf8(name).ok()?;
                Some(Self::Element(TableElement { id, kind, group, name }))
            }
            _ => None,
        }
    }

    /// Packet by which a vehicle answers.
    pub(super) fn reply(&self, table: TableKind) -> CrtpPacket {
        let packet = |command: u8| CrtpPacket::new(table.port(), CHANNEL, &[command]);
        match self {
            Self::Info(TableInfo { count, crc }) => {
                // Most log blocks, and variables in all of them.
                packet(INFO).with(&count.to_le_bytes()).with(&crc.to_le_bytes()).with(&[16, 128])
            }
            Self::Element(TableElement { id, kind, group, name }) => packet(ELEMENT)
                .with(&id.to_le_bytes())
                .with(&[*kind])
                .with(group.as_bytes())
                .with(&[0])
                .with(name.as_bytes())
                .with(&[0]),
            _ => packet(ELEMENT),
        }
    }
}
