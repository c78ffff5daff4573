//! A recording that is read: its facts, files, channels and messages. A file that ends in the middle is read up to its last chunk.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::read::{ChunkFlattener, Options};
use mcap::records::Record;

use super::channel::SCHEMA_KEY;
use super::facts::{CONFIG_FILE, LAYOUT, RECORDING};

/// Error of a recording; the message names the file and what is wrong.
#[derive(Debug, thiserror::Error)]
pub enum RecordingFileError {
    /// The file cannot be read.
    #[error(
        "{path}: {error}; expected a file that `oqtal fly` or `oqtal record` wrote (`fly --clock in-process` only with `--set record.flights=all`)"
    )]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// The file is no recording.
    #[error(
        "{path} is no recording of oqtal: {reason}; expected a file that `oqtal fly` or `oqtal record` wrote"
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is missing or wrong.
        reason: String,
    },
    /// The recording was made by a version with other message definitions.
    #[error(
        "{path} was recorded by oqtal {version} ({revision}), whose {what} differs from this version's; use that version"
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Version that recorded it.
        version: String,
        /// Revision of that version's sources.
        revision: String,
        /// What differs.
        what: String,
    },
}

/// A channel of a recording.
#[derive(Clone, Debug)]
pub struct RecordedChannel {
    /// Topic.
    pub topic: String,
    /// Name of its schema.
    pub schema: String,
    /// Hash of the message definition, in hexadecimal; empty for channels that are no topic of the bus.
    pub definition: String,
}

/// A message of a recording, encoded.
#[derive(Clone, Debug)]
pub struct RecordedMessage {
    /// Number of its channel \[-\].
    pub channel: u16,
    /// When it was received \[ns since the epoch\].
    pub log_time: u64,
    /// When it was published \[ns since the epoch\].
    pub publish_time: u64,
    /// The message, encoded.
    pub data: Vec<u8>,
}

/// A recording in memory.
#[derive(Clone, Debug)]
pub struct RecordingFile {
    /// The file.
    pub path: PathBuf,
    /// Size of the file \[bytes\].
    pub size: u64,
    /// Tables of facts by name; of several with one name the last.
    pub facts: BTreeMap<String, BTreeMap<String, String>>,
    /// Attached files by name.
    pub attachments: BTreeMap<String, Vec<u8>>,
    /// Channels by number \[-\].
    pub channels: BTreeMap<u16, RecordedChannel>,
    /// Messages in the order of the file.
    pub messages: Vec<RecordedMessage>,
    /// Why the file ends before its end; `None` if it is complete.
    pub cut_off: Option<String>,
}

impl RecordingFile {
    /// Reads the recording at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is no recording.
    pub fn read(path: &Path) -> Result<Self, RecordingFileError> {
        let failed = |error| RecordingFileError::Io { path: path.to_path_buf(), error };
        // A device has no end, and a pipe may have no writer.
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            let reason = "it is no regular file".to_owned();
            return Err(RecordingFileError::Foreign { path: path.to_path_buf(), reason });
        }
        Self::parse(path, &std::fs::read(path).map_err(failed)?)
    }

    /// Parses the content of the file at `path`.
    ///
    /// # Errors
    /// The content is no recording.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, RecordingFileError> {
        let foreign = |reason: &str| RecordingFileError::Foreign {
            path: path.to_path_buf(),
            reason: reason.to_owned(),
        };
        if bytes.is_empty() {
            return Err(foreign("it is empty"));
        }
        if !bytes.starts_with(mcap::MAGIC) {
            return Err(foreign("it does not begin as an MCAP file does"));
        }
        let mut file = Self {
            path: path.to_path_buf(),
            size: bytes.len() as u64,
            facts: BTreeMap::new(),
            attachments: BTreeMap::new(),
            channels: BTreeMap::new(),
            messages: Vec::new(),
            cut_off: None,
        };
        file.take_records(bytes).map_err(|error| foreign(&error.to_string()))?;
        match file.fact(RECORDING, "layout") {
            None => Err(foreign("it has no metadata `oqtal.recording`")),
            Some(LAYOUT) => Ok(file),
            Some(layout) => {
                let what = format!("layout of recordings, {layout} instead of {LAYOUT},");
                Err(file.other_version(&what))
            }
        }
    }

    /// Takes in the records up to the end of the data; an error after the first facts ends the file there.
    fn take_records(&mut self, bytes: &[u8]) -> Result<(), McapError> {
        let options = Options::IgnoreEndMagic | Options::ValidateChunkCrcs;
        let mut schemas = BTreeMap::new();
        // The reader ends a cut-off file without an error where a record ends.
        let mut is_complete = false;
        for record in ChunkFlattener::new_with_options(sound_prefix(bytes), options)? {
            match record {
                Ok(Record::Schema { header, .. }) => drop(schemas.insert(header.id, header.name)),
                Ok(Record::Footer(_)) => is_complete = true,
                Ok(record) => self.take(record, &schemas),
                Err(error) if self.facts.is_empty() => return Err(error),
                Err(error) => {
                    self.cut_off = Some(error.to_string());
                    return Ok(());
                }
            }
        }
        if !is_complete {
            self.cut_off = Some("MCAP file ended before its index".to_owned());
        }
        Ok(())
    }

    fn take(&mut self, record: Record<'_>, schemas: &BTreeMap<u16, String>) {
        match record {
            Record::Channel(channel) => {
                let schema = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let definition = channel.metadata.get(SCHEMA_KEY).cloned().unwrap_or_default();
                let topic = channel.topic;
                self.channels.insert(channel.id, RecordedChannel { topic, schema, definition });
            }
            Record::Message { header, data } => self.messages.push(RecordedMessage {
                channel: header.channel_id,
                log_time: header.log_time,
                publish_time: header.publish_time,
                data: data.into_owned(),
            }),
            Record::Metadata(metadata) => {
                self.facts.insert(metadata.name, metadata.metadata);
            }
            Record::Attachment { header, data, .. } => {
                self.attachments.insert(header.name, data.into_owned());
            }
            _ => {}
        }
    }

    /// A fact of a table.
    #[must_use]
    pub fn fact(&self, table: &str, name: &str) -> Option<&str> {
        self.facts.get(table)?.get(name).map(String::as_str)
    }

    /// Text of the effective configuration.
    ///
    /// # Errors
    /// The recording has none.
    pub fn config_text(&self) -> Result<String, RecordingFileError> {
        let bytes =
            self.attachments.get(CONFIG_FILE).ok_or_else(|| RecordingFileError::Foreign {
                path: self.path.clone(),
                reason: format!("it has no attachment `{CONFIG_FILE}`"),
            })?;
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// Time from an instant of the messages to the times of the file \[ns\]; zero for a flight in virtual time.
    #[must_use]
    pub fn wall_offset_ns(&self) -> i64 {
        self.fact(RECORDING, "wall_offset_ns").and_then(|text| text.parse().ok()).unwrap_or(0)
    }

    /// The error of a recording whose `what` differs from this version's.
    #[must_use]
    pub fn other_version(&self, what: &str) -> RecordingFileError {
        let fact = |name| self.fact(RECORDING, name).unwrap_or("unknown").to_owned();
        RecordingFileError::Version {
            path: self.path.clone(),
            version: fact("version"),
            revision: fact("revision"),
            what: what.to_owned(),
        }
    }
}

/// The file up to the first chunk whose records do not end where the chunk ends: the reader takes for granted that they do.
fn sound_prefix(bytes: &[u8]) -> &[u8] {
    let mut rest = bytes.get(mcap::MAGIC.len()..).unwrap_or_default();
    while let Some((opcode, body, next)) = first_record(rest) {
        if opcode == mcap::records::op::CHUNK && chunk_records(body).is_none_or(|r| !is_filled(r)) {
            return &bytes[..bytes.len() - rest.len()];
        }
        rest = next;
    }
    bytes
}

/// Whether `records` is records and nothing else.
fn is_filled(mut records: &[u8]) -> bool {
    while let Some((_, _, next)) = first_record(records) {
        records = next;
    }
    records.is_empty()
}

/// Opcode and body of the first record, and what follows it.
fn first_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (opcode, rest) = bytes.split_first()?;
    let (body, next) = prefixed(rest)?;
    Some((*opcode, body, next))
}

/// The records in the body of a chunk, after times, size and checksum, and the name of a compression, which we do not use.
fn chunk_records(body: &[u8]) -> Option<&[u8]> {
    let after_checksum = body.get(8 + 8 + 8 + 4..)?;
    let (name_length, rest) = after_checksum.split_first_chunk::<4>()?;
    let rest = rest.get(usize::try_from(u32::from_le_bytes(*name_length)).ok()?..)?;
    prefixed(rest).map(|(records, _)| records)
}

/// Bytes behind their length, and what follows them.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)
}
