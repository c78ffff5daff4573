//! An eventfd, with the message in shared memory.

use std::os::fd::AsFd;
use std::path::Path;

use oqtal_runtime::process::Failure;
use rustix::io::{Errno, read, write};

use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender};
use super::shared::Slot;

/// Either end of the mechanism. The eventfd is standard input.
#[derive(Debug)]
pub struct Eventfd {
    slot: Slot,
    seen: u32,
}

impl Eventfd {
    /// The receiving end, its memory at `path`.
    ///
    /// # Errors
    /// The memory cannot be shared.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let slot =
            Slot::open(path).map_err(|e| system(Mechanism::Eventfd, "sharing memory", &e))?;
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

impl ParcelSender for Eventfd {
    fn send(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        self.slot.put(parcel);
        let written = write(std::io::stdin().as_fd(), &1_u64.to_ne_bytes());
        written.map(drop).map_err(|error| system(Mechanism::Eventfd, "waking", &error))
    }
}

impl ParcelReceiver for Eventfd {
    fn receive(&mut self) -> Result<Parcel, Failure> {
        let stdin = std::io::stdin();
        loop {
            let mut count = [0; 8];
            match read(stdin.as_fd(), &mut count) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(error) => return Err(system(Mechanism::Eventfd, "waiting", &error)),
            }
            if let Ok((version, parcel)) = self.slot.get(self.seen) {
                self.seen = version;
                return Ok(parcel);
            }
        }
    }
}
