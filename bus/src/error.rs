//! What can go wrong on the bus.

use std::path::PathBuf;

/// What can go wrong on the bus, each with the object and the remedy in its message.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The topic has its one writer already.
    #[error(
        "topic `{topic}` of instance `{instance}` already has a writer; stop that process first, or use another --instance"
    )]
    Held {
        /// The topic.
        topic: &'static str,
        /// The instance.
        instance: String,
    },
    /// The other side was built from another version of the messages.
    #[error(
        "`{topic}` is spoken in another version by a running process; stop it and start all processes from one build"
    )]
    Version {
        /// The topic or service.
        topic: String,
    },
    /// The instance belongs to another user.
    #[error("no permission for {}; run as the user that owns it, or give another --root", path.display())]
    Permission {
        /// The root path of the instance.
        path: PathBuf,
    },
    /// Topics would not fit: a process that touches shared memory which is not there is killed, not told.
    #[error(
        "/dev/shm has {free_kib} KiB free, a process takes up to {needed_kib}; `sudo mount -o remount,size=512M /dev/shm`, or end other instances"
    )]
    Full {
        /// Shared memory free \[KiB\].
        free_kib: u64,
        /// What a process may take \[KiB\].
        needed_kib: u64,
    },
    /// A process keeps the lock of the instance.
    #[error(
        "{} is locked by a process that was stopped or hangs; find it with `fuser -v {}` and continue or end it",
        path.display(),
        path.display()
    )]
    Locked {
        /// The directory of the instance.
        path: PathBuf,
    },
    /// A name that cannot be part of the file names behind an instance.
    #[error("{what} `{value}` cannot be used: {rule}")]
    Name {
        /// What is named.
        what: &'static str,
        /// The name.
        value: String,
        /// What a name may be.
        rule: &'static str,
    },
    /// The operating system refused.
    #[error("{action} failed: {reason}")]
    System {
        /// What was tried.
        action: String,
        /// What came back.
        reason: String,
    },
}

pub(crate) fn system(action: impl Into<String>, reason: &dyn std::fmt::Debug) -> BusError {
    BusError::System { action: action.into(), reason: format!("{reason:?}") }
}

impl BusError {
    /// Shared memory has too little room for a file of `needed_kib`.
    pub(crate) fn full(needed_kib: u64) -> Self {
        let free = rustix::fs::statvfs("/dev/shm").map_or(0, |s| s.f_bavail * s.f_frsize);
        Self::Full { free_kib: free / 1024, needed_kib }
    }
}
