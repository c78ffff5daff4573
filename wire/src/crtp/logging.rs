//! Log blocks: variables that the vehicle sends together, each block at its own rate.

use super::packet::{CrtpPacket, CrtpPort};
use super::value::LogType;
use crate::bytes::{ByteOrder, ByteReader};

/// Most variables of a block that fits into one packet \[-\].
pub const MAX_LOG_VARIABLES: usize = 9;

/// Channel of settings, and of data.
pub(super) const SETTINGS: u8 = 1;
pub(super) const DATA: u8 = 2;

/// Variables of one log block, by their numbers in the table of contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogBlock {
    /// Number of the block \[-\].
    pub id: u8,
    variables: [(LogType, u16); MAX_LOG_VARIABLES],
    count: usize,
}

impl LogBlock {
    /// Block without variables.
    pub fn new(id: u8) -> Self {
        Self { id, variables: [(LogType::U8, 0); MAX_LOG_VARIABLES], count: 0 }
    }

    /// The block with one more variable, sent in its stored type; unchanged if it has [`MAX_LOG_VARIABLES`] already.
    pub fn with(mut self, kind: LogType, id: u16) -> Self {
        if let Some(place) = self.variables.get_mut(self.count) {
            *place = (kind, id);
            self.count += 1;
        }
        self
    }

    /// Types and numbers of the variables.
    pub fn variables(&self) -> &[(LogType, u16)] {
        &self.variables[..self.count]
    }

    pub(super) fn create_packet(&self, command: u8) -> CrtpPacket {
        let packet = CrtpPacket::new(CrtpPort::Logging, SETTINGS, &[command, self.id]);
        self.variables().iter().fold(packet, |packet, (kind, id)| {
            // Stored as, and sent as.
            let kinds = (*kind as u8) << 4 | *kind as u8;
            packet.with(&[kinds]).with(&id.to_le_bytes())
        })
    }

    pub(super) fn read(id: u8, fields: &[u8]) -> Option<Self> {
        let mut block = Self::new(id);
        for piece in fields.chunks_exact(3).take(MAX_LOG_VARIABLES) {
            let kind = LogType::from_wire(piece[0])?;
            block = block.with(kind, u16::from_le_bytes([piece[1], piece[2]]));
        }
        Some(block)
    }
}

/// Values of one log packet, read in the order of the block's variables.
#[derive(Clone, Copy, Debug)]
pub struct LogFields<'a> {
    fields: ByteReader<'a>,
}

impl<'a> LogFields<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { fields: ByteReader::new(bytes, ByteOrder::Little) }
    }

    /// The next value \[-\], of type `kind`; `None` where the packet ends.
    pub fn next(&mut self, kind: LogType) -> Option<f64> {
        let fields = &mut self.fields;
        Some(match kind {
            LogType::U8 => f64::from(fields.u8()?),
            LogType::I8 => f64::from(fields.u8()?.cast_signed()),
            LogType::U16 => f64::from(fields.u16()?),
            LogType::I16 => f64::from(fields.i16()?),
            LogType::U32 => f64::from(fields.u32()?),
            LogType::I32 => f64::from(fields.i32()?),
            LogType::F32 => f64::from(fields.f32()?),
        })
    }

    /// Bytes that are not read yet.
    pub fn rest(&self) -> &'a [u8] {
        self.fields.rest()
    }
}

impl PartialEq for LogFields<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.rest() == other.rest()
    }
}

/// Bytes of `number` as a value of type `kind`, for the vehicle's end.
pub(super) fn put_value(packet: CrtpPacket, kind: LogType, number: f64) -> CrtpPacket {
    match kind {
        LogType::U8 => packet.with(&[number as u8]),
        LogType::I8 => packet.with(&[(number as i8).cast_unsigned()]),
        LogType::U16 => packet.with(&(number as u16).to_le_bytes()),
        LogType::I16 => packet.with(&(number as i16).to_le_bytes()),
        LogType::U32 => packet.with(&(number as u32).to_le_bytes()),
        LogType::I32 => packet.with(&(number as i32).to_le_bytes()),
        LogType::F32 => packet.with(&(number as f32).to_le_bytes()),
    }
}
