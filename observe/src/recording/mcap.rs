//! The container format MCAP, version 0 (<https://mcap.dev/spec>), without compression: records of an opcode, a length and a body, in
//! little-endian order.
//!
//! | file | subject |
//! |---|---|
//! | `encode.rs` | records as bytes |
//! | `decode.rs` | records from bytes |

pub mod decode;
pub mod encode;

use crc::{CRC_32_ISO_HDLC, Crc, Table};

/// First and last bytes of a file.
pub const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Checksum of chunks, attachments, data section and summary section.
pub static CHECKSUM: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// Kind of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)]
pub enum Opcode {
    Header = 0x01,
    Footer = 0x02,
    Schema = 0x03,
    Channel = 0x04,
    Message = 0x05,
    Chunk = 0x06,
    MessageIndex = 0x07,
    ChunkIndex = 0x08,
    Attachment = 0x09,
    AttachmentIndex = 0x0a,
    Statistics = 0x0b,
    Metadata = 0x0c,
    MetadataIndex = 0x0d,
    SummaryOffset = 0x0e,
    DataEnd = 0x0f,
}
