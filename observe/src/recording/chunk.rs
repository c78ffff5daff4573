//! Messages collected for the file: the records of one chunk, with their index.

use std::collections::BTreeMap;

use super::mcap::Opcode;
use super::mcap::encode::Fields;

/// Maximum time from the first message of a chunk to its end \[ns of the messages' times\].
const CHUNK_NS: u64 = 500_000_000;
/// Size of the records that ends a chunk \[bytes\].
const CHUNK_BYTES: usize = 1 << 20;

/// Header of a message in a file.
#[derive(Clone, Copy, Debug)]
pub struct McapMessage {
    /// Channel number, in the order of [`super::channel::Channel::all`] \[-\].
    pub channel: u16,
    /// Number of the message within its channel \[-\].
    pub sequence: u32,
    /// Time of reception \[ns since the epoch\].
    pub log_time: u64,
    /// Time of publication \[ns since the epoch\].
    pub publish_time: u64,
}

/// Messages of at most half a second.
#[derive(Debug, Default)]
pub struct Chunk {
    /// The messages as records.
    pub records: Vec<u8>,
    /// Time of each message \[ns since the epoch\] and position of its record \[bytes\], by channel.
    pub index: BTreeMap<u16, Vec<[u64; 2]>>,
    /// Times of the first and last message; `None` without messages \[ns since the epoch\].
    pub extent: Option<(u64, u64)>,
    /// Number of messages \[-\].
    pub messages: u64,
}

impl Chunk {
    /// Adds a message, encoded in `data`; times must not decrease.
    pub fn push(&mut self, message: McapMessage, data: &[u8]) {
        let McapMessage { channel, sequence, log_time, publish_time } = message;
        self.index.entry(channel).or_default().push([log_time, self.records.len() as u64]);
        self.records.record(Opcode::Message, |bytes| {
            bytes.extend(channel.to_le_bytes());
            bytes.extend(sequence.to_le_bytes());
            bytes.u64s(&[log_time, publish_time]);
            bytes.extend_from_slice(data);
        });
        self.extent = Some((self.extent.map_or(log_time, |(first, _)| first), log_time));
        self.messages += 1;
    }

    /// Whether the chunk must be written before a message at `log_time` is added \[ns since the epoch\].
    pub fn is_due(&self, log_time: u64) -> bool {
        let is_old = |(first, _): (u64, u64)| log_time.saturating_sub(first) >= CHUNK_NS;
        self.records.len() >= CHUNK_BYTES || self.extent.is_some_and(is_old)
    }
}
