//! Private part of shared memory of an instance. All users may make files in `/dev/shm`, so another user could occupy a
//! predictable name before the instance does.
//!
//! The first process of an instance draws a random number. Names of this run of the instance begin with it and [`SEPARATOR`]. It
//! is also the name of a directory that only its owner can access and that contains the shared words. A link in the directory of
//! the instance points to this directory.
//!
//! Every member process holds a shared lock (`flock`) on the directory of its run. A run exists while its directory is locked, even if
//! files of the instance were removed.
//!
//! A run belongs to one directory of an instance, by device and inode, not by name: a directory that was moved or copied, or created again
//! under its name, does not lead a process into the run of another one. The files of iceoryx2, which it finds by their paths, are in the
//! directory of the run, whose name is not used again.

use std::fs::{DirBuilder, File};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, RenameFlags, flock, renameat_with};

use crate::error::{BusError, system};
use crate::message::short_digits;
use crate::remains;

/// Name of the link in the directory of an instance.
pub(crate) const LINK: &str = "shared";

/// Link in the directory of a run of which a file was lost that cannot be restored, to the path of that file: made at once, and only
/// once. The members of that run leave, and no process joins it.
const LOSS: &str = "loss";

/// Link in the directory of a run to the identity of the directory of its instance.
const HOME: &str = "home";

/// Separator after the random number in the names of iceoryx2, which refuses to list files if a name equals the prefix. The name
/// of the private directory has no separator.
const SEPARATOR: char = '_';

/// Run of an instance in which this process takes part: its private directory, with a shared lock on it.
#[derive(Debug)]
pub(crate) struct InstanceRun {
    /// Private directory.
    pub(crate) path: PathBuf,
    lock: File,
}

impl InstanceRun {
    /// Takes part in the living run of the instance with this prefix and directory, and restores a missing link to it; `None` if
    /// there is none. To be called under `lock`, the lock of the directory.
    ///
    /// # Errors
    /// The link cannot be restored.
    pub(crate) fn join(
        prefix: &str,
        directory: &Path,
        lock: &File,
    ) -> Result<Option<Self>, BusError> {
        let is_whole = |run: &Path| {
            let home = std::fs::read_link(run.join(HOME)).ok();
            loss(run).is_none() && home.is_some() && home == identity(lock)
        };
        match linked(directory) {
            Some(path) => Ok(Some(path).filter(|path| is_whole(path)).and_then(Self::enter)),
            None => {
                let mut runs = remains::runs(remains::SHARED_MEMORY.as_ref(), prefix).into_iter();
                let whole = runs.find(|run| run.is_alive() && is_whole(&run.directory()));
                let joined = whole.and_then(|run| Self::enter(run.directory()));
                joined.iter().try_for_each(|run| run.link(directory))?;
                Ok(joined)
            }
        }
    }

    /// Takes part in the run with the private directory `path`; `None` if it has no member.
    fn enter(path: PathBuf) -> Option<Self> {
        let lock = remains::open_own_directory(&path)?;
        let is_alive = flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err();
        let joined = flock(&lock, FlockOperation::NonBlockingLockShared).is_ok();
        (is_alive && joined).then_some(Self { path, lock })
    }

    /// Starts a run of the instance with this prefix and directory, and creates the link to it. To be called under `lock`, the lock of the
    /// directory, while no run of this directory lives.
    ///
    /// # Errors
    /// The operating system refuses.
    pub(crate) fn start(prefix: &str, directory: &Path, lock: &File) -> Result<Self, BusError> {
        let random = short_digits(RandomState::new().hash_one(std::process::id()));
        let path = remains::shared(&format!("{prefix}{random}"));
        let failed = |error: io::Error| system(format!("creating {}", path.display()), &error);
        // Locked before it has its name: a directory of this name without a lock was left by dead processes.
        let unnamed = remains::shared(&format!(".{prefix}{random}"));
        DirBuilder::new().mode(0o700).create(&unnamed).map_err(failed)?;
        let locked = remains::open_own_directory(&unnamed)
            .ok_or_else(|| failed(io::ErrorKind::PermissionDenied.into()))?;
        flock(&locked, FlockOperation::NonBlockingLockShared).map_err(|e| failed(e.into()))?;
        let cwd = rustix::fs::CWD;
        renameat_with(cwd, &unnamed, cwd, &path, RenameFlags::NOREPLACE)
            .map_err(|e| failed(e.into()))?;
        let home = identity(lock).ok_or_else(|| failed(io::ErrorKind::NotFound.into()))?;
        symlink(home, path.join(HOME)).map_err(failed)?;
        let run = Self { path, lock: locked };
        run.link(directory)?;
        Ok(run)
    }

    /// Creates the link to this run in the directory of its instance; the caller holds the lock.
    ///
    /// # Errors
    /// The operating system refuses.
    pub(crate) fn link(&self, directory: &Path) -> Result<(), BusError> {
        let link = directory.join(LINK);
        let made = match std::fs::remove_file(&link) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => symlink(&self.path, &link),
        };
        made.map_err(|error| system(format!("linking {}", link.display()), &error))
    }

    /// Whether the link in the directory of the instance leads to this run.
    pub(crate) fn is_linked(&self, directory: &Path) -> bool {
        linked(directory).is_some_and(|path| path == self.path)
    }

    /// Prefix of the names of iceoryx2 in this run.
    pub(crate) fn prefix(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        format!("{}{SEPARATOR}", name.to_string_lossy())
    }

    /// Whether the private directory is still there under its name.
    pub(crate) fn is_present(&self) -> bool {
        is_same(&self.lock, &self.path)
    }

    /// Whether no other process takes part. The run then ends: no other process can join it any more.
    pub(crate) fn ends(&self) -> bool {
        flock(&self.lock, FlockOperation::NonBlockingLockExclusive).is_ok()
    }

    /// A handle to the same run, which counts as the same member.
    pub(crate) fn clone_handle(&self) -> io::Result<Self> {
        Ok(Self { path: self.path.clone(), lock: self.lock.try_clone()? })
    }
}

/// Records in the directory `run` of a run the loss of `path`, for its members that do not use that file. Without the directory, each
/// member detects the loss itself.
pub(crate) fn record_loss(run: &Path, path: &Path) {
    let _ = symlink(path, run.join(LOSS));
}

/// The lost file that is recorded in the directory `run` of a run.
pub(crate) fn loss(run: &Path) -> Option<PathBuf> {
    std::fs::read_link(run.join(LOSS)).ok()
}

/// Private directory to which the link in the directory of an instance leads.
pub(crate) fn linked(directory: &Path) -> Option<PathBuf> {
    std::fs::read_link(directory.join(LINK)).ok()
}

/// Device and inode of an open file, which no other file has while it is open.
fn identity(file: &File) -> Option<PathBuf> {
    file.metadata().ok().map(|file| format!("{}:{}", file.dev(), file.ino()).into())
}

/// Whether `path` names the file that is open as `file`.
pub(crate) fn is_same(file: &File, path: &Path) -> bool {
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(ours), Ok(present)) => (ours.dev(), ours.ino()) == (present.dev(), present.ino()),
        _ => false,
    }
}
