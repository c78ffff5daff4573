//! A message in memory that two processes share.

use std::fs::OpenOptions;
use std::path::Path;
use std::ptr;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

use rustix::mm::{MapFlags, ProtFlags, mmap};

use super::{Parcel, WORDS};

/// A message and its version: odd while it is being written, even when it is whole.
#[derive(Debug)]
#[repr(C)]
pub struct Slot {
    version: AtomicU32,
    words: [AtomicU64; WORDS],
}

impl Slot {
    /// The slot in the file at `path`, made if it is not there. It stays mapped as long as the process lives.
    ///
    /// # Errors
    /// The file cannot be opened or mapped.
    #[allow(unsafe_code)]
    pub fn map(path: &Path) -> std::io::Result<&'static Self> {
        let file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        file.set_len(size_of::<Self>() as u64)?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: no address is asked for, so the kernel maps where nothing is; nothing existing is touched.
        let memory = unsafe {
            mmap(ptr::null_mut(), size_of::<Self>(), access, MapFlags::SHARED, &file, 0)?
        };
        // SAFETY: the mapping is page-aligned, as long as a `Slot`, zeroed or written by another `Slot`, and never unmapped,
        // so it lives for 'static. All its fields are atomics, valid for any bits, so the other process may write it while
        // this reference is held. The file is ours, in a directory of this run, and nobody shortens it.
        Ok(unsafe { &*memory.cast::<Self>() })
    }

    /// The word that changes with every message: what a futex waits on.
    #[must_use]
    pub fn version(&self) -> &AtomicU32 {
        &self.version
    }

    /// Writes a message. There is one writer.
    pub fn put(&self, parcel: &Parcel) {
        let version = self.version.load(Ordering::Relaxed);
        self.version.store(version.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        for (word, value) in self.words.iter().zip(parcel.words()) {
            word.store(value, Ordering::Relaxed);
        }
        self.version.store(version.wrapping_add(2), Ordering::Release);
    }

    /// The message, with its version, if it is whole and not the one of version `seen`; else the version that it has.
    ///
    /// # Errors
    /// The version to wait on.
    pub fn get(&self, seen: u32) -> Result<(u32, Parcel), u32> {
        let version = self.version.load(Ordering::Acquire);
        if version == seen || !version.is_multiple_of(2) {
            return Err(version);
        }
        let mut words = [0; WORDS];
        for (value, word) in words.iter_mut().zip(&self.words) {
            *value = word.load(Ordering::Relaxed);
        }
        fence(Ordering::Acquire);
        match self.version.load(Ordering::Relaxed) {
            same if same == version => Ok((version, Parcel::of_words(&words))),
            other => Err(other),
        }
    }
}
