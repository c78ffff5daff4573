//! Membership of an instance: its processes, and the lock for changes to its files.
//!
//! Membership consists of three locks (`flock`). The kernel releases them when the process that holds them ends, for any reason:
//! - the directory of the instance: locked exclusively for the short time in which a process joins, opens or closes ports, or
//!   leaves. Incomplete files found by the holder were left by a dead process.
//! - the directory of the run in shared memory: shared, as long as the process is a member ([`crate::private`]).
//! - the file `members`: shared as well. It shows that an instance is alive whose directory in shared memory was removed.
//!
//! No file of a living instance is removed, whichever other file of it is missing. A member that leaves removes the files of the
//! instance through the directory that it has open, not those of another one that has taken its name. The processes
//! notice a missing file themselves ([`crate::watch`]).

use std::cell::Cell;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use iceoryx2::prelude::Config;
use rustix::fs::{FlockOperation, flock};

use crate::error::{BusError, of_iceoryx};
use crate::member_files::{MEMBERS, Members, acquire, has_members, open_directory};
use crate::paths::{CHAIN, CHAIN_UNREADY, CONFIG, InstancePaths, LAW, LAW_UNREADY, WIRE};
use crate::private::{self, InstanceRun, is_same};
use crate::remains;
use crate::time::{Span, Time};

/// Running processes hold the lock for milliseconds; a process that holds it longer was stopped or hangs.
const LOCK_TIMEOUT: Span = Span::from_millis(3000);
/// Closing has a shorter time-out: files that cannot be removed now are removed by the next process that joins.
const CLOSE_TIMEOUT: Span = Span::from_millis(300);

/// Files in the directory of an instance that end with its last process, beside the daemon's configuration.
const SESSION_FILES: [&str; 5] = [WIRE, LAW, LAW_UNREADY, CHAIN, CHAIN_UNREADY];

/// Membership of one process in an instance, until it is dropped.
#[derive(Debug)]
pub(crate) struct Membership {
    prefix: String,
    directory: PathBuf,
    lock: File,
    members: Members,
    run: InstanceRun,
    /// Whether the daemon's configuration remains if this process is the last to leave.
    keeps_config: Cell<bool>,
    /// Number of [`InstanceLock`]s of this membership \[-\].
    depth: Cell<u32>,
    /// Whether the lock was not free when a port was last closed.
    closes_unlocked: Cell<bool>,
}

/// Exclusive right to change the files of an instance, until it is dropped.
#[derive(Debug)]
pub(crate) struct InstanceLock<'a>(&'a Membership);

impl Membership {
    /// Joins the instance at `paths`. Files left by dead processes are removed; files that belong to a living run stay.
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
            if !is_same(&lock, &directory) {
                continue;
            }
            let prefix = paths.prefix();
            let run = match InstanceRun::join(&prefix, &directory, &lock)? {
                Some(run) => run,
                None => start_run(&prefix, &directory, &lock)?,
            };
            remains::remove_dead(&prefix);
            let members = Members::default();
            members.join(&directory)?;
            let (depth, closes_unlocked) = (Cell::new(0), Cell::new(false));
            let keeps_config = Cell::new(false);
            let _ = flock(&lock, FlockOperation::Unlock);
            return Ok(Rc::new(Self {
                prefix,
                directory,
                lock,
                members,
                run,
                keeps_config,
                depth,
                closes_unlocked,
            }));
        }
    }

    /// Whether a process is a member of the instance at `paths`. Creates and removes nothing.
    pub(crate) fn exists(paths: &InstancePaths) -> bool {
        let directory = paths.directory();
        private::linked(&directory).is_some_and(|run| remains::is_alive(&run))
            || has_members(&directory)
            || remains::runs(remains::SHARED_MEMORY.as_ref(), &paths.prefix())
                .iter()
                .any(remains::RunRemains::is_alive)
    }

    /// Directory by its path and open, run and members of this membership, for a watch over their files.
    ///
    /// # Errors
    /// The process has too many open files.
    pub(crate) fn files(&self) -> io::Result<((PathBuf, File), InstanceRun, Members)> {
        let home = (self.directory.clone(), self.lock.try_clone()?);
        Ok((home, self.run.clone_handle()?, self.members.clone()))
    }

    /// Leaves the configuration of the daemon, which may have been killed, for the next one.
    pub(crate) fn keep_config(&self) {
        self.keeps_config.set(true);
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
        self.run.path.join(name)
    }

    /// Configuration of iceoryx2 for this run: its files are in the directory of the run.
    ///
    /// # Errors
    /// The name of the run is refused.
    pub(crate) fn config(&self) -> Result<Config, BusError> {
        let refused = |error| of_iceoryx("naming the files of the instance", &error);
        let root = format!("{}/", self.run.path.display());
        let mut config = Config::default();
        config.global.set_root_path(&root.as_str().try_into().map_err(refused)?);
        config.global.prefix = self.run.prefix().as_str().try_into().map_err(refused)?;
        Ok(config)
    }

    /// Whether no other process can join this run of the instance.
    pub(crate) fn is_lost(&self) -> bool {
        let Self { directory, lock, run, .. } = self;
        let is_here = is_same(lock, directory) && run.is_linked(directory);
        !is_here || !run.is_present() || private::loss(&run.path).is_some()
    }
}

impl InstanceLock<'_> {
    /// Removes objects of dead processes that iceoryx2 would wait for.
    pub(crate) fn remove_empty(&self) {
        remains::remove_empty(&self.0.run.prefix());
    }

    /// Removes incomplete files of dead processes.
    pub(crate) fn remove_half_made(&self) {
        remains::remove_half_made(&self.0.run.prefix(), &self.0.run.path);
    }

    /// Allocates the memory of all shared files of the instance.
    ///
    /// # Errors
    /// Shared memory is full.
    pub(crate) fn reserve_memory(&self) -> Result<(), BusError> {
        remains::reserve_memory(&self.0.run.prefix())
            .map_err(|size| BusError::full(size.div_ceil(1024)))
    }

    /// Revokes other users' access to files in shared memory.
    pub(crate) fn make_private(&self) {
        remains::make_private(&self.0.run.prefix());
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
        if !self.run.ends() {
            return;
        }
        let is_linked = self.run.is_linked(&self.directory);
        remains::remove_run(&self.run.path);
        // After a loss the directory may belong to another run.
        if is_same(&self.lock, &self.directory) && is_linked {
            remains::remove_dead(&self.prefix);
            // The open directory, even if another one has just taken its name.
            let open = PathBuf::from(format!("/proc/self/fd/{}", self.lock.as_raw_fd()));
            remove(&open, &[&SESSION_FILES[..], &[private::LINK, MEMBERS]].concat());
            if !self.keeps_config.get() {
                remove(&open, &[CONFIG]);
            }
            // Only an empty directory is removed; a process waiting for its lock checks this.
            let _ = std::fs::remove_dir(&self.directory);
        }
    }
}

/// Starts a run of the instance; the caller holds its lock. Processes that still hold the file `members` have lost their run, and end
/// without a request. The configuration of a daemon that was killed remains for the next one.
fn start_run(prefix: &str, directory: &Path, lock: &File) -> Result<InstanceRun, BusError> {
    remove(directory, &[&SESSION_FILES[..], &[MEMBERS]].concat());
    InstanceRun::start(prefix, directory, lock)
}

/// Removes files that exist.
fn remove(directory: &Path, names: &[&str]) {
    for name in names {
        let _ = std::fs::remove_file(directory.join(name));
    }
}
