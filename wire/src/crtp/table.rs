//! Tables of contents: the vehicle numbers its parameters and its log variables, and a CRC identifies known tables.

use super::packet::{CrtpPacket, CrtpPort};
use crate::bytes::ByteReader;

/// Channel of tables.
const CHANNEL: u8 = 0;
/// Command of an element, of up to 65536.
pub(super) const ELEMENT: u8 = 2;
/// Command of size and CRC.
pub(super) const INFO: u8 = 3;

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

    /// Packet of a request about the table or the answer to it, up to the fields of `command`.
    pub(super) fn packet(self, command: u8) -> CrtpPacket {
        CrtpPacket::new(self.port(), CHANNEL, &[command])
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

    pub(super) fn packet(&self, table: TableKind) -> CrtpPacket {
        let Self { count, crc } = self;
        // Most log blocks, and variables in all of them.
        let limits = [16, 128];
        table.packet(INFO).with(&count.to_le_bytes()).with(&crc.to_le_bytes()).with(&limits)
    }

    pub(super) fn read(mut fields: ByteReader<'_>) -> Option<Self> {
        Some(Self { count: fields.u16()?, crc: fields.u32()? })
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
    /// Name of the entry within the group.
    pub name: &'a str,
}

impl<'a> TableElement<'a> {
    pub(super) fn packet(&self, table: TableKind) -> CrtpPacket {
        let Self { id, kind, group, name } = self;
        table
            .packet(ELEMENT)
            .with(&id.to_le_bytes())
            .with(&[*kind])
            .with(group.as_bytes())
            .with(&[0])
            .with(name.as_bytes())
            .with(&[0])
    }

    pub(super) fn read(mut fields: ByteReader<'a>) -> Option<Self> {
        let (id, kind) = (fields.u16()?, fields.u8()?);
        let group = fields.text()?;
        // The end of the second name is the end of the packet; some firmware ends it by a NUL as well.
        let name = fields.rest().split(|byte| *byte == 0).next().unwrap_or_default();
        let name = std::str::from_utf8(name).ok()?;
        Some(Self { id, kind, group, name })
    }
}
