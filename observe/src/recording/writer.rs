//! One MCAP file: chunked, indexed, uncompressed. A chunk is written whole and handed to the operating system, so that a file whose
//! writer was killed is readable up to its last chunk.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapResult, WriteOptions, Writer};

use super::channel::Channel;
use super::facts::Facts;

/// Longest time from the first message of a chunk to its writing \[ns of the messages' times\].
const CHUNK_NS: u64 = 500_000_000;
/// Bytes that the format adds to a message \[bytes\].
const MESSAGE_OVERHEAD: u64 = 31;

/// What is known of a message on its way into a file.
#[derive(Clone, Copy, Debug)]
pub struct McapMessage {
    /// Number of its channel, in the order of [`Channel::all`] \[-\].
    pub channel: u16,
    /// Number of the message among those of its channel \[-\].
    pub sequence: u32,
    /// When it was received \[ns since the epoch\].
    pub log_time: u64,
    /// When it was published \[ns since the epoch\].
    pub publish_time: u64,
}

/// Messages that go to the writing thread together: one wake-up and one allocation for many.
#[derive(Debug, Default)]
pub struct MessageBatch {
    /// Each with the end of its data in `data`.
    messages: Vec<(McapMessage, usize)>,
    data: Vec<u8>,
}

impl MessageBatch {
    /// Adds a message, encoded in `data`.
    pub fn push(&mut self, message: McapMessage, data: &[u8]) {
        self.data.extend_from_slice(data);
        self.messages.push((message, self.data.len()));
    }

    /// Number of messages \[-\].
    #[must_use]
    pub fn len(&self) -> usize {
        self.messages.len()
    }

    /// Time of the first message; `None` if there is none \[ns since the epoch\].
    #[must_use]
    pub fn began(&self) -> Option<u64> {
        self.messages.first().map(|(message, _)| message.log_time)
    }

    /// The messages with their data, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = (&McapMessage, &[u8])> {
        let begins = std::iter::once(0).chain(self.messages.iter().map(|(_, end)| *end));
        let parts = self.messages.iter().zip(begins);
        parts.map(|((message, end), begin)| (message, &self.data[begin..*end]))
    }

    /// An empty batch with room for as much as this one has.
    #[must_use]
    pub fn replacement(&self) -> Self {
        let messages = Vec::with_capacity(self.messages.len());
        Self { messages, data: Vec::with_capacity(self.data.len()) }
    }
}

/// What every file of a recording begins with: tables of facts, and files by name with media type and content.
#[derive(Clone, Debug, Default)]
pub struct Preamble {
    /// Tables of facts.
    pub facts: Vec<Facts>,
    /// Name, media type and content of files.
    pub files: Vec<(String, &'static str, Vec<u8>)>,
    /// Name of the program that writes.
    pub library: String,
}

/// A file under way.
pub struct McapFile {
    writer: Writer<BufWriter<File>>,
    /// Number in the file by number of the channel.
    channels: Vec<u16>,
    /// Time of the first message of the present chunk, and of the file.
    chunk_began: Option<u64>,
    began: Option<u64>,
    bytes: u64,
}

impl McapFile {
    /// Creates the file at `path` and writes everything before the first message.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn create(path: &Path, preamble: &Preamble) -> McapResult<Self> {
        let file = BufWriter::new(File::create_new(path)?);
        let options = WriteOptions::new()
            .compression(None)
            // A chunk is collected in memory: none is ever half written with a length that is not yet known.
            .disable_seeking(true)
            .chunk_size(Some(4 << 20))
            .library(preamble.library.clone());
        let mut writer = options.create(file)?;
        for Facts { name, entries } in &preamble.facts {
            writer.write_metadata(&Metadata { name: name.clone(), metadata: entries.clone() })?;
        }
        for (name, media_type, data) in &preamble.files {
            let (name, media_type) = (name.clone(), (*media_type).to_owned());
            let data = data.as_slice().into();
            writer.attach(&Attachment { log_time: 0, create_time: 0, name, media_type, data })?;
        }
        let channels = add_channels(&mut writer)?;
        writer.flush()?;
        Ok(Self { writer, channels, chunk_began: None, began: None, bytes: 0 })
    }

    /// Adds a message; writes the chunk before it if that is old enough.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn message(&mut self, message: &McapMessage, data: &[u8]) -> McapResult<()> {
        let McapMessage { channel, sequence, log_time, publish_time } = message;
        if self.chunk_began.is_some_and(|began| log_time.saturating_sub(began) >= CHUNK_NS) {
            self.flush()?;
        }
        self.chunk_began.get_or_insert(*log_time);
        self.began.get_or_insert(*log_time);
        self.bytes += data.len() as u64 + MESSAGE_OVERHEAD;
        let channel_id = self.channels[usize::from(*channel)];
        let header = MessageHeader {
            channel_id,
            sequence: *sequence,
            log_time: *log_time,
            publish_time: *publish_time,
        };
        self.writer.write_to_known_channel(&header, data)
    }

    /// Adds a table of facts.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn facts(&mut self, facts: &Facts) -> McapResult<()> {
        let Facts { name, entries } = facts.clone();
        self.chunk_began = None;
        self.writer.write_metadata(&Metadata { name, metadata: entries })?;
        self.writer.flush()
    }

    /// Writes the present chunk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> McapResult<()> {
        self.chunk_began = None;
        self.writer.flush()
    }

    /// Size of the messages so far \[bytes\].
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Time from the first message to `log_time` \[ns\].
    #[must_use]
    pub fn age(&self, log_time: u64) -> u64 {
        self.began.map_or(0, |began| log_time.saturating_sub(began))
    }

    /// Writes the index and closes the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> McapResult<()> {
        self.writer.finish().map(drop)
    }

    /// Closes the file as it is, after an error: its chunks remain readable.
    pub fn abandon(self) {
        drop(self.writer.into_inner());
    }
}

/// Adds every channel; returns their numbers in the file.
fn add_channels(writer: &mut Writer<BufWriter<File>>) -> McapResult<Vec<u16>> {
    let mut numbers = Vec::new();
    for channel in Channel::all() {
        let schema = channel.schema();
        let id = writer.add_schema(&schema.name, "ros2msg", schema.text.as_bytes())?;
        let metadata: &BTreeMap<String, String> = &schema.metadata;
        numbers.push(writer.add_channel(id, &channel.name(), "cdr", metadata)?);
    }
    Ok(numbers)
}
