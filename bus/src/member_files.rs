//! Files by whose locks an instance is joined: its directory, and the file `members` in it.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;

use crate::error::{BusError, system};
use crate::private::is_same;
use crate::remains;
use crate::time::Time;

/// File whose shared lock marks the member processes.
pub(crate) const MEMBERS: &str = "members";

/// The file `members`, locked by this process; replaced if it was removed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Members(Arc<Mutex<Option<File>>>);

impl Members {
    /// Opens and locks the file in `directory`; the caller holds the lock of the instance.
    pub(crate) fn join(&self, directory: &Path) -> Result<(), BusError> {
        let path = directory.join(MEMBERS);
        let flags = (OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).mode(0o600).custom_flags(flags);
        let file = options.open(&path).map_err(|error| {
            let is_other = error.kind() == io::ErrorKind::IsADirectory;
            let remedy = if is_other { "; remove this directory" } else { "" };
            system(format!("opening {}", path.display()), &format_args!("{error}{remedy}"))
        })?;
        // Waits at most for a process that is just looking whether there are members.
        flock(&file, FlockOperation::LockShared)
            .map_err(|error| system(format!("joining {}", directory.display()), &error))?;
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(file);
        Ok(())
    }

    /// Whether the file is still there under its name.
    pub(crate) fn are_present(&self, directory: &Path) -> bool {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.as_ref().is_some_and(|file| is_same(file, &directory.join(MEMBERS)))
    }
}

/// Whether a process holds the file `members` in `directory`.
pub(crate) fn has_members(directory: &Path) -> bool {
    let file = File::open(directory.join(MEMBERS));
    file.is_ok_and(|file| flock(&file, FlockOperation::NonBlockingLockExclusive).is_err())
}

/// Opens the directory of an instance, made if it does not exist.
pub(crate) fn open_directory(directory: &Path) -> Result<File, BusError> {
    let failed = |e: &io::Error| {
        let is_other = e.kind() == io::ErrorKind::NotADirectory;
        let remedy = if is_other { "; remove this file or link" } else { "" };
        system(format!("opening {}", directory.display()), &format_args!("{e}{remedy}"))
    };
    match DirBuilder::new().mode(0o700).create(directory) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(&error)),
        _ => {}
    }
    let file = match remains::open_directory(directory) {
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

/// Locks an open directory of an instance, until `give_up` at the latest.
pub(crate) fn acquire(lock: &File, directory: &Path, give_up: Time) -> Result<(), BusError> {
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
