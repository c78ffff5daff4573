//! A futex on a word in shared memory: the lower bound for waking a sleeping process.

use std::path::Path;

use oqtal_runtime::process::Failure;
use rustix::io::Errno;
use rustix::thread::futex::{Flags, wait, wake};

use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender};
use super::shared::Slot;

/// Either end of the mechanism.
#[derive(Debug)]
pub struct Futex {
    slot: Slot,
    seen: u32,
}

impl Futex {
    /// The receiving end, at `path`.
    ///
    /// # Errors
    /// The memory cannot be shared.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let slot = Slot::open(path).map_err(|e| system(Mechanism::Futex, "sharing memory", &e))?;
        Ok(Self { slot, seen: 0 })
    }

    /// The sending end.
    ///
    /// # Errors
    /// The memory cannot be shared.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        Self::create(path)
    }
}

impl ParcelSender for Futex {
    fn send(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        self.slot.put(parcel);
        // Not private: the other end is another process.
        let woken = wake(self.slot.version(), Flags::empty(), 1);
        woken.map(drop).map_err(|error| system(Mechanism::Futex, "waking", &error))
    }
}

impl ParcelReceiver for Futex {
    fn receive(&mut self) -> Result<Parcel, Failure> {
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
