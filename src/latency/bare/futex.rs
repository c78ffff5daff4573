//! A futex in shared memory: wait on a word, wake who waits. Nothing in user space is faster asleep.

use std::path::Path;

use oqtal_runtime::process::Failure;
use rustix::io::Errno;
use rustix::thread::futex::{Flags, wait, wake};

use super::shared::Slot;
use super::{Giver, Mechanism, Parcel, Taker, system};

/// Either end.
#[derive(Debug)]
pub struct Futex {
    slot: Slot,
    seen: u32,
}

impl Futex {
    /// The taking end, at `path`.
    ///
    /// # Errors
    /// The memory cannot be shared.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let slot = Slot::open(path).map_err(|e| system(Mechanism::Futex, "sharing memory", &e))?;
        Ok(Self { slot, seen: 0 })
    }

    /// The giving end.
    ///
    /// # Errors
    /// The memory cannot be shared.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        Self::create(path)
    }
}

impl Giver for Futex {
    fn give(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        self.slot.put(parcel);
        // Not private: the other end is another process.
        let woken = wake(self.slot.version(), Flags::empty(), 1);
        woken.map(drop).map_err(|error| system(Mechanism::Futex, "waking", &error))
    }
}

impl Taker for Futex {
    fn take(&mut self) -> Result<Parcel, Failure> {
        loop {
            match self.slot.get(self.seen) {
                Ok((version, parcel)) => {
                    self.seen = version;
                    return Ok(parcel);
                }
                Err(version) => match wait(self.slot.version(), Flags::empty(), version, None) {
                    Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
                    Err(error) => return Err(system(Mechanism::Futex, "waiting", &error)),
                },
            }
        }
    }
}
