//! Decoder of records from bytes that may be truncated or damaged.

use std::collections::BTreeMap;

use super::CHECKSUM;

/// Remaining bytes. Every method removes the value that it returns, and returns `None` if the bytes are too short.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a>(pub &'a [u8]);

impl<'a> Cursor<'a> {
    /// The next `length` bytes.
    pub fn bytes(&mut self, length: u64) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(usize::try_from(length).ok()?)?;
        self.0 = rest;
        Some(bytes)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }

    /// A 16-bit number.
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    /// A 32-bit number.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// A 64-bit number.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A text preceded by its length.
    pub fn text(&mut self) -> Option<String> {
        let length = self.u32()?;
        String::from_utf8(self.bytes(length.into())?.to_vec()).ok()
    }

    /// A table of texts.
    pub fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()?;
        let mut fields = Self(self.bytes(length.into())?);
        let mut entries = BTreeMap::new();
        while !fields.0.is_empty() {
            entries.insert(fields.text()?, fields.text()?);
        }
        Some(entries)
    }

    /// Opcode and body of the next record.
    pub fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let [opcode] = self.array()?;
        let length = self.u64()?;
        Some((opcode, self.bytes(length)?))
    }
}

/// Records in the body of a chunk; `None` if it is compressed or damaged.
pub fn chunk(body: &[u8]) -> Option<&[u8]> {
    let mut fields = Cursor(body);
    let (_times, size) = (fields.bytes(16)?, fields.u64()?);
    let (checksum, compression, length) = (fields.u32()?, fields.text()?, fields.u64()?);
    let records = fields.bytes(length)?;
    let is_sound = compression.is_empty() && size == length && agrees(checksum, records);
    is_sound.then_some(records)
}

/// Name and content of an attachment, from its body; `None` if it is damaged.
pub fn attachment(body: &[u8]) -> Option<(String, &[u8])> {
    let mut fields = Cursor(body);
    fields.bytes(16)?;
    let (name, _media_type, length) = (fields.text()?, fields.text()?, fields.u64()?);
    let content = fields.bytes(length)?;
    let checked = &body[..body.len() - fields.0.len()];
    agrees(fields.u32()?, checked).then_some((name, content))
}

/// Whether `checksum` is the checksum of `bytes`, or 0 (none).
fn agrees(checksum: u32, bytes: &[u8]) -> bool {
    checksum == 0 || checksum == CHECKSUM.checksum(bytes)
}
