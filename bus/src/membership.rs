//! Membership of an instance: its processes, and the lock for changes to its files.
//!
//! Membership consists of two locks (`flock`). The kernel releases them when the process that holds them ends, for any reason:
//! - the directory of the instance: locked exclusively for the short time in which a process joins, opens or closes ports, or
//!   leaves. Incomplete files found by the holder were left by a dead process.
//! - the file `members` in it: shared, as long as the process is a member. A process that gets an exclusive lock is the only
//!   member.

use std::cell::Cell;
use std::fs::{DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;

use crate::error::{BusError, system};
use crate::paths::{InstancePaths, LAW, WIRE};
use crate::time::{Span, Time};
use crate::{private, remains};

/// Running processes hold the lock for milliseconds; a process that holds it longer was stopped or hangs.
const LOCK_TIMEOUT: Span = Span::from_millis(3000);
/// Closing has a shorter time-out: files that cannot be removed now are removed by the next process that joins.
const CLOSE_TIMEOUT: Span = Span::from_millis(300);

/// Membership of one process in an instance, until it is dropped.
#[derive(Debug)]
pub(crate) struct Membership {
    prefix: String,
    directory: PathBuf,
    lock: File,
    members: File,
    /// Number of [`InstanceLock`]s of this membership \[-\].
    depth: Cell<u32>,
    /// Whether the lock was not free when a port was last closed.
    closes_unlocked: Cell<bool>,
}

/// Exclusive right to change the files of an instance, until it is dropped.
#[derive(Debug)]
pub(crate) struct InstanceLock<'a>(&'a Membership);

impl Membership {
    /// Joins the instance at `paths`. If there are no other members, files left by dead processes are removed.
    ///
    /// # Errors
    /// The instance belongs to another user, or a suspended process holds its lock.
    pub(crate) fn join(paths: &InstancePaths) -> Result<Rc<Self>, BusError> {
        let directory = paths.directory();
        let give_up = Time::now() + LOCK_TIMEOUT;
        loop {
            let lock = open_directory(&directory)?;
            acquire(&lock, &directory, give_up)?;
            // The last process may have removed the directory before the lock was free.
            if !is_current(&lock, &directory) {
                continue;
            }
            let members = open_members(&directory)?;
            if flock(&members, FlockOperation::NonBlockingLockExclusive).is_ok() {
                remains::remove_all(&paths.prefix(), &directory);
                remove(&directory, &[WIRE, LAW]);
                private::make(&paths.prefix(), &directory)?;
            }
            flock(&members, FlockOperation::NonBlockingLockShared)
                .map_err(|e| system(format!("joining {}", directory.display()), &e))?;
            let prefix = paths.prefix();
            let (depth, closes_unlocked) = (Cell::new(0), Cell::new(false));
            let joined = Self { prefix, directory, lock, members, depth, closes_unlocked };
            let _ = flock(&joined.lock, FlockOperation::Unlock);
            return Ok(Rc::new(joined));
        }
    }

    /// Locks the files of the instance. A lock already held by this membership is shared.
    ///
    /// # Errors
    /// A suspended process holds the lock.
    pub(crate) fn lock(&self) -> Result<InstanceLock<'_>, BusError> {
        self.lock_within(LOCK_TIMEOUT)
    }

    /// Like [`Membership::lock`], with a short time-out, for closing a port; `None` if the lock is not free. A process that ends
    /// waits once, not once per port.
    pub(crate) fn lock_to_close(&self) -> Option<InstanceLock<'_>> {
        let timeout = if self.closes_unlocked.get() { Span::ZERO } else { CLOSE_TIMEOUT };
        let lock = self.lock_within(timeout).ok();
        self.closes_unlocked.set(lock.is_none());
        lock
    }

    fn lock_within(&self, timeout: Span) -> Result<InstanceLock<'_>, BusError> {
        if self.depth.get() == 0 {
            acquire(&self.lock, &self.directory, Time::now() + timeout)?;
        }
        self.depth.set(self.depth.get() + 1);
        Ok(InstanceLock(self))
    }

    /// Path of the shared words `name` of this instance.
    pub(crate) fn words_file(&self, name: &str) -> PathBuf {
        self.directory.join(private::LINK).join(name)
    }

    /// Prefix of the names of iceoryx2; the caller holds the lock.
    ///
    /// # Errors
    /// As [`private::prefix`].
    pub(crate) fn private_prefix(&self, _lock: &InstanceLock<'_>) -> Result<String, BusError> {
        private::prefix(&self.directory)
    }

    /// Removes incomplete files of dead processes; the caller holds the lock.
    pub(crate) fn remove_half_made(&self, _lock: &InstanceLock<'_>) {
        remains::remove_half_made(&self.prefix, &self.directory);
    }

    /// Allocates the memory of all shared files of the instance; the caller holds the lock.
    ///
    /// # Errors
    /// Shared memory is full.
    pub(crate) fn reserve_memory(&self, _lock: &InstanceLock<'_>) -> Result<(), BusError> {
        remains::reserve_memory(&self.prefix).map_err(|size| BusError::full(size.div_ceil(1024)))
    }

    /// Revokes other users' access to files in shared memory; the caller holds the lock.
    pub(crate) fn make_private(&self, _lock: &InstanceLock<'_>) {
        remains::make_private(&self.prefix);
    }
}

impl Drop for InstanceLock<'_> {
    fn drop(&mut self) {
        self.0.depth.set(self.0.depth.get() - 1);
        if self.0.depth.get() == 0 {
            // Fails only for a closed descriptor, and closing unlocks as well.
            let _ = flock(&self.0.lock, FlockOperation::Unlock);
        }
    }
}

impl Drop for Membership {
    fn drop(&mut self) {
        let Some(_lock) = self.lock_to_close() else { return };
        if flock(&self.members, FlockOperation::NonBlockingLockExclusive).is_ok() {
            remains::remove_all(&self.prefix, &self.directory);
            // Only an empty directory is removed; a process waiting for its lock checks this.
            remove(&self.directory, &[WIRE, LAW, private::LINK, MEMBERS]);
            let _ = std::fs::remove_dir(&self.directory);
        }
    }
}

/// File whose shared lock marks the member processes.
pub(crate) const MEMBERS: &str = "members";

/// Removes files that exist.
fn remove(directory: &Path, names: &[&str]) {
    for name in names {
        let _ = std::fs::remove_file(directory.join(name));
    }
}

fn open_directory(directory: &Path) -> Result<File, BusError> {
    let failed = |e: &io::Error| system(format!("opening {}", directory.display()), e);
    match DirBuilder::new().mode(0o700).create(directory) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(&error)),
        _ => {}
    }
    let flags = (OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
    let opened = OpenOptions::new().read(true).custom_flags(flags).open(directory);
    let file = match opened {
        // The directory was removed between the two steps and is made again.
        Err(error) if error.kind() == io::ErrorKind::NotFound => return open_directory(directory),
        other => other.map_err(|e| failed(&e))?,
    };
    let owner = file.metadata().map_err(|e| failed(&e))?.uid();
    if owner != rustix::process::geteuid().as_raw() {
        return Err(BusError::Permission { path: directory.to_path_buf() });
    }
    Ok(file)
}

fn open_members(directory: &Path) -> Result<File, BusError> {
    let path = directory.join(MEMBERS);
    let flags = (OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false).mode(0o600).custom_flags(flags);
    options.open(&path).map_err(|e| system(format!("opening {}", path.display()), &e))
}

fn acquire(lock: &File, directory: &Path, give_up: Time) -> Result<(), BusError> {
    loop {
        match flock(lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => return Ok(()),
            Err(Errno::WOULDBLOCK | Errno::INTR) if Time::now() < give_up => {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err(Errno::WOULDBLOCK | Errno::INTR) => {
                return Err(BusError::Locked { path: directory.to_path_buf() });
            }
            Err(error) => return Err(system(format!("locking {}", directory.display()), &error)),
        }
    }
}

fn is_current(lock: &File, directory: &Path) -> bool {
    match (lock.metadata(), std::fs::symlink_metadata(directory)) {
        (Ok(ours), Ok(present)) => (ours.dev(), ours.ino()) == (present.dev(), present.ino()),
        _ => false,
    }
}
