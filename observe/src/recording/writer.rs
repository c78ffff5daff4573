//! One MCAP file: chunked, indexed, uncompressed. Every complete chunk is handed to the operating system, so that the file of a
//! killed writer is readable up to its last chunk.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use crc::{Digest, Table};

use super::channel::Channel;
use super::chunk::Chunk;
use super::facts::Facts;
use super::mcap::encode::Fields;
use super::mcap::{CHECKSUM, MAGIC, Opcode};

/// Length of a footer's body \[bytes\].
const FOOTER_BYTES: u64 = 8 + 8 + 4;

/// Name, media type and content of a file in a recording.
pub type AttachedFile = (String, &'static str, Vec<u8>);

/// First records of every file of a recording: tables of facts, and files by name with media type and content.
#[derive(Clone, Debug, Default)]
pub struct Preamble {
    /// Tables of facts.
    pub facts: Vec<Facts>,
    /// Name, media type and content of files.
    pub files: Vec<AttachedFile>,
    /// Name of the writing program.
    pub library: String,
}

/// File being written.
pub struct McapFile {
    file: File,
    /// Size so far \[bytes\].
    size: u64,
    checksum: Digest<'static, u32, Table<16>>,
    /// Records of the summary section by kind, in the order of the section.
    summary: Vec<(Opcode, Vec<u8>)>,
    chunks: u32,
    attachments: u32,
    tables: u32,
    /// Messages by channel \[-\].
    messages: BTreeMap<u16, u64>,
    /// Times of the first and the last message \[ns since the epoch\].
    extent: Option<(u64, u64)>,
}

impl McapFile {
    /// Creates the file at `path` and writes the records before the first message.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn create(path: &Path, preamble: &Preamble) -> io::Result<Self> {
        use Opcode::{AttachmentIndex, ChunkIndex, MetadataIndex, Schema};
        let kinds = [Schema, Opcode::Channel, AttachmentIndex, MetadataIndex, ChunkIndex];
        let mut created = Self {
            file: File::create_new(path)?,
            size: 0,
            checksum: CHECKSUM.digest(),
            summary: kinds.map(|kind| (kind, Vec::new())).to_vec(),
            chunks: 0,
            attachments: 0,
            tables: 0,
            messages: BTreeMap::new(),
            extent: None,
        };
        let mut bytes = MAGIC.to_vec();
        bytes.record(Opcode::Header, |bytes| {
            bytes.text("");
            bytes.text(&preamble.library);
        });
        created.write(&bytes)?;
        preamble.facts.iter().try_for_each(|facts| created.facts(facts))?;
        preamble.files.iter().try_for_each(|file| created.attachment(file))?;
        created.channels()?;
        Ok(created)
    }

    /// Another handle to the file.
    ///
    /// # Errors
    /// The process has too many open files.
    pub fn handle(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Appends bytes of the data section.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.checksum.update(bytes);
        self.size += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    /// The records of a kind in the summary section.
    fn summary(&mut self, kind: Opcode) -> &mut Vec<u8> {
        let found = self.summary.iter().position(|(other, _)| *other == kind);
        &mut self.summary[found.expect("every kind is created with the file")].1
    }

    /// Writes schemas and channels. Both have the channel numbers; schema numbers start at 1.
    fn channels(&mut self) -> io::Result<()> {
        for (number, channel) in (0_u16..).zip(Channel::all()) {
            let schema = channel.schema();
            let id = number + 1;
            self.summary(Opcode::Schema).record(Opcode::Schema, |bytes| {
                bytes.extend(id.to_le_bytes());
                bytes.text(&schema.name);
                bytes.text("ros2msg");
                bytes.text(&schema.text);
            });
            self.summary(Opcode::Channel).record(Opcode::Channel, |bytes| {
                bytes.extend(number.to_le_bytes());
                bytes.extend(id.to_le_bytes());
                bytes.text(&channel.name());
                bytes.text("cdr");
                bytes.map(&schema.metadata);
            });
        }
        let [schemas, channels] =
            [Opcode::Schema, Opcode::Channel].map(|kind| self.summary(kind).clone());
        self.write(&schemas)?;
        self.write(&channels)
    }

    /// Writes a chunk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn chunk(&mut self, chunk: &Chunk) -> io::Result<()> {
        let Chunk { records, index, extent: Some((first, last)), .. } = chunk else {
            return Ok(());
        };
        let (begin, size) = (self.size, records.len() as u64);
        let mut bytes = Vec::with_capacity(records.len() + 4096);
        bytes.record(Opcode::Chunk, |bytes| {
            bytes.u64s(&[*first, *last, size]);
            bytes.extend(CHECKSUM.checksum(records).to_le_bytes());
            bytes.text("");
            bytes.u64s(&[size]);
            bytes.extend_from_slice(records);
        });
        let length = bytes.len() as u64;
        let mut positions = Vec::new();
        for (channel, entries) in index {
            positions.push((*channel, begin + bytes.len() as u64));
            bytes.record(Opcode::MessageIndex, |bytes| {
                bytes.extend(channel.to_le_bytes());
                bytes.sized(|bytes| bytes.u64s(entries.as_flattened()));
            });
            *self.messages.entry(*channel).or_default() += entries.len() as u64;
        }
        let index_length = bytes.len() as u64 - length;
        self.summary(Opcode::ChunkIndex).record(Opcode::ChunkIndex, |bytes| {
            bytes.u64s(&[*first, *last, begin, length]);
            bytes.sized(|bytes| positions.iter().for_each(|entry| counted(bytes, *entry)));
            bytes.u64s(&[index_length]);
            bytes.text("");
            bytes.u64s(&[size, size]);
        });
        self.chunks += 1;
        self.extent = Some((self.extent.map_or(*first, |(first, _)| first), *last));
        self.write(&bytes)
    }

    /// Writes a table of facts.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn facts(&mut self, facts: &Facts) -> io::Result<()> {
        let mut bytes = Vec::new();
        bytes.record(Opcode::Metadata, |bytes| {
            bytes.text(&facts.name);
            bytes.map(&facts.entries);
        });
        let place = [self.size, bytes.len() as u64];
        self.summary(Opcode::MetadataIndex).record(Opcode::MetadataIndex, |bytes| {
            bytes.u64s(&place);
            bytes.text(&facts.name);
        });
        self.tables += 1;
        self.write(&bytes)
    }

    /// Attaches a file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn attachment(&mut self, file: &AttachedFile) -> io::Result<()> {
        let (name, media_type, content) = file;
        let length = content.len() as u64;
        let mut bytes = Vec::new();
        bytes.record(Opcode::Attachment, |bytes| {
            let begin = bytes.len();
            bytes.u64s(&[0, 0]);
            bytes.text(name);
            bytes.text(media_type);
            bytes.u64s(&[length]);
            bytes.extend_from_slice(content);
            let checksum = CHECKSUM.checksum(&bytes[begin..]);
            bytes.extend(checksum.to_le_bytes());
        });
        let place = [self.size, bytes.len() as u64, 0, 0, length];
        self.summary(Opcode::AttachmentIndex).record(Opcode::AttachmentIndex, |bytes| {
            bytes.u64s(&place);
            bytes.text(name);
            bytes.text(media_type);
        });
        self.attachments += 1;
        self.write(&bytes)
    }

    /// Time from the first message to `log_time` \[ns\].
    pub fn age(&self, log_time: u64) -> u64 {
        self.extent.map_or(0, |(first, _)| log_time.saturating_sub(first))
    }

    /// Size so far \[bytes\].
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Writes the summary section and closes the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        let statistics = self.statistics();
        self.summary.push((Opcode::Statistics, statistics));
        let mut bytes = Vec::new();
        let checksum = self.checksum.finalize();
        bytes.record(Opcode::DataEnd, |bytes| bytes.extend(checksum.to_le_bytes()));
        let data_end = bytes.len();
        let begin = self.size + data_end as u64;
        let mut groups = Vec::new();
        for (kind, records) in self.summary.iter().filter(|(_, records)| !records.is_empty()) {
            groups.push((*kind as u8, [self.size + bytes.len() as u64, records.len() as u64]));
            bytes.extend_from_slice(records);
        }
        let offsets = self.size + bytes.len() as u64;
        for (kind, place) in groups {
            bytes.record(Opcode::SummaryOffset, |bytes| {
                bytes.push(kind);
                bytes.u64s(&place);
            });
        }
        // The checksum covers the footer up to the checksum itself, including opcode and length.
        bytes.push(Opcode::Footer as u8);
        bytes.u64s(&[FOOTER_BYTES, begin, offsets]);
        let checksum = CHECKSUM.checksum(&bytes[data_end..]);
        bytes.extend(checksum.to_le_bytes());
        bytes.extend(MAGIC);
        self.file.write_all(&bytes)
    }

    fn statistics(&self) -> Vec<u8> {
        let channels = Channel::all().count() as u32;
        let (first, last) = self.extent.unwrap_or_default();
        let mut bytes = Vec::new();
        bytes.record(Opcode::Statistics, |bytes| {
            bytes.u64s(&[self.messages.values().sum()]);
            bytes.extend((channels as u16).to_le_bytes());
            for count in [channels, self.attachments, self.tables, self.chunks] {
                bytes.extend(count.to_le_bytes());
            }
            bytes.u64s(&[first, last]);
            bytes.sized(|bytes| {
                self.messages
                    .iter()
                    .for_each(|(channel, count)| counted(bytes, (*channel, *count)));
            });
        });
        bytes
    }
}

/// Appends an entry of a table of numbers by channel.
fn counted(bytes: &mut Vec<u8>, (channel, number): (u16, u64)) {
    bytes.extend(channel.to_le_bytes());
    bytes.u64s(&[number]);
}
