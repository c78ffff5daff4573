//! A message in memory that two processes share.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering, fence};

use oqtal_bus::shared::SharedWords;

use super::parcel::{Parcel, WORDS};

/// A message and its version: odd while it is being written, even when it is whole. The version is the first word, the message
/// the others, in halves.
#[derive(Debug)]
pub struct Slot(SharedWords);

impl Slot {
    /// Opens the slot in the file at `path`, which is made if it is not there.
    ///
    /// # Errors
    /// The file cannot be opened or mapped.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        Ok(Self(SharedWords::open(path, 1 + 2 * WORDS)?))
    }

    /// The word that changes with every message: what a futex waits on.
    #[must_use]
    pub fn version(&self) -> &AtomicU32 {
        &self.0[0]
    }

    fn halves(&self) -> &[[AtomicU32; 2]] {
        self.0[1..].as_chunks().0
    }

    /// Writes a message. There is one writer.
    pub fn put(&self, parcel: &Parcel) {
        let version = self.version().load(Ordering::Relaxed);
        self.version().store(version.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        for ([low, high], value) in self.halves().iter().zip(parcel.words()) {
            low.store(lower_half(value), Ordering::Relaxed);
            high.store(lower_half(value >> 32), Ordering::Relaxed);
        }
        self.version().store(version.wrapping_add(2), Ordering::Release);
    }

    /// Returns the message and its version if it is whole and not the one of version `seen`.
    ///
    /// # Errors
    /// The version to wait on.
    pub fn get(&self, seen: u32) -> Result<(u32, Parcel), u32> {
        let version = self.version().load(Ordering::Acquire);
        if version == seen || !version.is_multiple_of(2) {
            return Err(version);
        }
        let mut words = [0; WORDS];
        for (value, [low, high]) in words.iter_mut().zip(self.halves()) {
            let high = u64::from(high.load(Ordering::Relaxed));
            *value = high << 32 | u64::from(low.load(Ordering::Relaxed));
        }
        fence(Ordering::Acquire);
        match self.version().load(Ordering::Relaxed) {
            same if same == version => Ok((version, Parcel::of_words(&words))),
            other => Err(other),
        }
    }
}

fn lower_half(value: u64) -> u32 {
    (value & 0xffff_ffff) as u32
}
