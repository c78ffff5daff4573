//! Reading of a recording: its facts, files, channels and messages. A truncated file is read up to its last chunk.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::channel::SCHEMA_KEY;
use super::facts::{CONFIG_FILE, LAYOUT, RECORDING};
use super::mcap::decode::{Cursor, attachment, chunk};
use super::mcap::{MAGIC, Opcode};

/// Error of a recording; the message names file and problem.
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
    /// The file is not a recording.
    #[error(
        "{path} is not a recording of oqtal: {reason}; expected a file that `oqtal fly` or `oqtal record` wrote"
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Part that is missing or wrong.
        reason: String,
    },
    /// The recording has no flight of the number that was named.
    #[error("{path} has {flights} flights, numbered from 1; `oqtal info` lists them")]
    NoFlight {
        /// The file.
        path: PathBuf,
        /// Number of its flights \[-\].
        flights: usize,
    },
    /// The recording was made by a version with other message definitions.
    #[error(
        "{path} was recorded by oqtal {version} ({revision}), whose {what} differs from this version's; use that version"
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Version that made the recording.
        version: String,
        /// Revision of that version's sources.
        revision: String,
        /// Part that differs.
        what: String,
    },
}

impl RecordingFileError {
    /// Whether the version that made the recording can read it, and this one cannot.
    pub fn is_of_another_version(&self) -> bool {
        matches!(self, Self::Version { .. })
    }
}

/// Whether the file at `path` begins like a recording, complete or not.
pub fn is_recording(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == MAGIC
}

/// A channel of a recording.
#[derive(Clone, Debug)]
pub struct RecordedChannel {
    /// Topic.
    pub topic: String,
    /// Name of the schema.
    pub schema: String,
    /// Hash of the message definition, in hexadecimal; empty for channels that are not topics of the bus.
    pub definition: String,
}

/// A message of a recording, encoded.
#[derive(Clone, Debug)]
pub struct RecordedMessage {
    /// Channel number \[-\].
    pub channel: u16,
    /// Time of reception \[ns since the epoch\].
    pub log_time: u64,
    /// Time of publication \[ns since the epoch\].
    pub publish_time: u64,
    /// The message, encoded.
    pub data: Vec<u8>,
}

/// A recording in memory.
#[derive(Clone, Debug, Default)]
pub struct RecordingFile {
    /// The file.
    pub path: PathBuf,
    /// Size of the file \[bytes\].
    pub size: u64,
    /// Tables of facts by name; the last one if a name occurs several times.
    pub facts: BTreeMap<String, BTreeMap<String, String>>,
    /// Attached files by name.
    pub attachments: BTreeMap<String, Vec<u8>>,
    /// Channels by number \[-\].
    pub channels: BTreeMap<u16, RecordedChannel>,
    /// Messages in the order of the file.
    pub messages: Vec<RecordedMessage>,
    /// Reason why the file ends before its index; `None` if it is complete.
    pub cut_off: Option<String>,
    /// Names of schemas by number.
    schemas: BTreeMap<u16, String>,
}

impl RecordingFile {
    /// Reads the recording at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is not a recording.
    pub fn read(path: &Path) -> Result<Self, RecordingFileError> {
        let failed = |error| RecordingFileError::Io { path: path.to_path_buf(), error };
        // A device has no end, and a pipe may have no writer.
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            let reason = "it is not a regular file".to_owned();
            return Err(RecordingFileError::Foreign { path: path.to_path_buf(), reason });
        }
        Self::parse(path, &std::fs::read(path).map_err(failed)?)
    }

    /// Parses the content of the file at `path`.
    ///
    /// # Errors
    /// The content is not a recording.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, RecordingFileError> {
        let foreign = |reason: &str| RecordingFileError::Foreign {
            path: path.to_path_buf(),
            reason: reason.to_owned(),
        };
        if bytes.is_empty() {
            return Err(foreign("it is empty"));
        }
        let Some(records) = bytes.strip_prefix(&MAGIC) else {
            return Err(foreign("it does not begin as an MCAP file does"));
        };
        let (path, size) = (path.to_path_buf(), bytes.len() as u64);
        let mut file = Self { path, size, ..Self::default() };
        file.cut_off = file.read_records(records).err();
        match file.fact(RECORDING, "layout") {
            None => {
                let missing = "it has no metadata `oqtal.recording`";
                Err(foreign(file.cut_off.as_deref().unwrap_or(missing)))
            }
            Some(LAYOUT) => Ok(file),
            Some(layout) => {
                let what = format!("layout of recordings, {layout} instead of {LAYOUT},");
                Err(file.other_version(&what))
            }
        }
    }

    /// A recording with the messages of this one that `keeps` keeps, and everything else.
    pub(super) fn holding(&self, keeps: impl Fn(&RecordedMessage) -> bool) -> Self {
        let Self { path, size, channels, facts, attachments, messages, cut_off, schemas } = self;
        Self {
            path: path.clone(),
            size: *size,
            channels: channels.clone(),
            facts: facts.clone(),
            attachments: attachments.clone(),
            messages: messages.iter().filter(|message| keeps(message)).cloned().collect(),
            cut_off: cut_off.clone(),
            schemas: schemas.clone(),
        }
    }

    /// Adds the records up to the footer, or up to the first damaged or truncated one, in which case it fails with the reason.
    fn read_records(&mut self, bytes: &[u8]) -> Result<(), String> {
        let mut rest = Cursor(bytes);
        while !rest.0.is_empty() {
            let (opcode, body) =
                rest.record().ok_or("MCAP file ended in the middle of a record")?;
            if opcode == Opcode::Footer as u8 {
                return Ok(());
            }
            self.add(opcode, body).ok_or_else(|| format!("record {opcode:#04x} is damaged"))?;
        }
        Err("MCAP file ended before its index".to_owned())
    }

    /// Adds a record of the data section; `None` if it is damaged.
    fn add(&mut self, opcode: u8, body: &[u8]) -> Option<()> {
        let mut fields = Cursor(body);
        match opcode {
            op if op == Opcode::Chunk as u8 => self.add_chunk(chunk(body)?)?,
            op if op == Opcode::Schema as u8 => {
                self.schemas.insert(fields.u16()?, fields.text()?);
            }
            op if op == Opcode::Channel as u8 => {
                let (number, schema) = (fields.u16()?, fields.u16()?);
                let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
                let (topic, _encoding, metadata) = (fields.text()?, fields.text()?, fields.map()?);
                let definition = metadata.get(SCHEMA_KEY).cloned().unwrap_or_default();
                self.channels.insert(number, RecordedChannel { topic, schema, definition });
            }
            op if op == Opcode::Message as u8 => {
                let (channel, _sequence) = (fields.u16()?, fields.u32()?);
                let (log_time, publish_time) = (fields.u64()?, fields.u64()?);
                let data = fields.0.to_vec();
                self.messages.push(RecordedMessage { channel, log_time, publish_time, data });
            }
            op if op == Opcode::Metadata as u8 => {
                self.facts.insert(fields.text()?, fields.map()?);
            }
            op if op == Opcode::Attachment as u8 => {
                let (name, content) = attachment(body)?;
                self.attachments.insert(name, content.to_vec());
            }
            _ => {}
        }
        Some(())
    }

    /// Adds the records of a chunk; `None`, without adding any, if they do not end at the end of the chunk, or if one is a chunk:
    /// chunks within chunks would exhaust the stack.
    fn add_chunk(&mut self, records: &[u8]) -> Option<()> {
        let mut rest = Cursor(records);
        while !rest.0.is_empty() {
            let (opcode, _) = rest.record()?;
            if opcode == Opcode::Chunk as u8 {
                return None;
            }
        }
        let mut rest = Cursor(records);
        while let Some((opcode, body)) = rest.record() {
            self.add(opcode, body)?;
        }
        Some(())
    }

    /// Value of a fact in a table.
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

    /// Offset from message instants to the times of the file \[ns\]; zero for a flight in virtual time.
    pub fn wall_offset_ns(&self) -> i64 {
        self.fact(RECORDING, "wall_offset_ns").and_then(|text| text.parse().ok()).unwrap_or(0)
    }

    /// Error of a recording whose part `what` differs from this version's.
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
