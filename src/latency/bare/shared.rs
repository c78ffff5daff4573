//! A message in memory shared by two processes. The receiver is woken by a futex, the lower bound for waking a process, or by an
//! eventfd.

use std::io;
use std::os::fd::AsFd;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering, fence};

use oqtal_bus::shared::SharedWords;
use rustix::io::{Errno, read, write};
use rustix::thread::futex::{Flags, wait, wake};

use super::parcel::{Parcel, ParcelReceiver, ParcelSender, WORDS};

/// Sender at `path` that wakes the receiver by a futex.
///
/// # Errors
/// The memory cannot be shared.
pub fn futex_sender(path: &Path) -> io::Result<ParcelSender> {
    // The futex is not private: the other end is another process.
    sender(path, |slot| wake(slot.version(), Flags::empty(), 1).map(drop))
}

/// Receiver at `path` that waits on a futex.
///
/// # Errors
/// The memory cannot be shared.
pub fn futex_receiver(path: &Path) -> io::Result<ParcelReceiver> {
    receiver(path, |slot, version| wait(slot.version(), Flags::empty(), version, None))
}

/// Sender at `path` that wakes the receiver by the eventfd at standard input.
///
/// # Errors
/// The memory cannot be shared.
pub fn eventfd_sender(path: &Path) -> io::Result<ParcelSender> {
    sender(path, |_| write(std::io::stdin().as_fd(), &1_u64.to_ne_bytes()).map(drop))
}

/// Receiver at `path` that reads the eventfd at standard input.
///
/// # Errors
/// The memory cannot be shared.
pub fn eventfd_receiver(path: &Path) -> io::Result<ParcelReceiver> {
    receiver(path, |_, _| read(std::io::stdin().as_fd(), &mut [0; 8]).map(drop))
}

fn sender(
    path: &Path,
    wake: impl Fn(&Slot) -> rustix::io::Result<()> + 'static,
) -> io::Result<ParcelSender> {
    let slot = Slot::open(path)?;
    Ok(Box::new(move |parcel| {
        slot.put(parcel);
        Ok(wake(&slot)?)
    }))
}

/// Receiver that uses `sleep` to wait until the version of the slot may differ from a given one.
fn receiver(
    path: &Path,
    sleep: impl Fn(&Slot, u32) -> rustix::io::Result<()> + 'static,
) -> io::Result<ParcelReceiver> {
    let (slot, mut seen) = (Slot::open(path)?, 0);
    Ok(Box::new(move || {
        loop {
            let version = match slot.get(seen) {
                Ok((version, parcel)) => {
                    seen = version;
                    return Ok(parcel);
                }
                Err(version) => version,
            };
            match sleep(&slot, version) {
                Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }))
}

/// Message with a version: odd while the message is being written, even when it is complete. The version is the first word; the
/// message occupies the others, in halves.
#[derive(Debug)]
struct Slot(SharedWords);

impl Slot {
    /// Opens the slot in the file at `path`, which is created if it does not exist.
    fn open(path: &Path) -> io::Result<Self> {
        Ok(Self(SharedWords::open(path, 1 + 2 * WORDS)?))
    }

    /// The word that changes with every message, on which a futex waits.
    fn version(&self) -> &AtomicU32 {
        &self.0[0]
    }

    fn halves(&self) -> &[[AtomicU32; 2]] {
        self.0[1..].as_chunks().0
    }

    /// Writes a message. There is one writer.
    fn put(&self, parcel: &Parcel) {
        let version = self.version().load(Ordering::Relaxed);
        self.version().store(version.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        for ([low, high], value) in self.halves().iter().zip(parcel.words()) {
            low.store(lower_half(value), Ordering::Relaxed);
            high.store(lower_half(value >> 32), Ordering::Relaxed);
        }
        self.version().store(version.wrapping_add(2), Ordering::Release);
    }

    /// Returns the message and its version if it is complete and newer than version `seen`; otherwise the version to wait on.
    fn get(&self, seen: u32) -> Result<(u32, Parcel), u32> {
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
