//! Errors of the bus.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Error of the bus; the message names the object and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// Another writer holds the topic.
    #[error(
        "topic `{topic}` of instance `{instance}` is held by {holder}; {}, or use another --instance",
        how_to_end(topic)
    )]
    Held {
        /// The topic.
        topic: &'static str,
        /// The instance.
        instance: String,
        /// Name and id of the process that writes the topic.
        holder: String,
    },
    /// The topic has its maximum number of observers.
    #[error(
        "topic `{topic}` has {count} observers, the most that it can have: {holders}; end one of them first"
    )]
    Crowded {
        /// The topic.
        topic: &'static str,
        /// Number of observers \[-\].
        count: usize,
        /// Process ids and names of the observers.
        holders: String,
    },
    /// A running process was built from other definitions of the messages.
    #[error(
        "`{topic}` is used by a running process of another version; stop it and start all processes from one build"
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
    /// Shared memory is full. Access to memory that cannot be allocated would end the process by a signal.
    #[error(
        "/dev/shm has {free_kib} KiB free, a process needs up to {needed_kib}; `sudo mount -o remount,size=512M /dev/shm`, or end other instances"
    )]
    Full {
        /// Shared memory free \[KiB\].
        free_kib: u64,
        /// Memory that is needed \[KiB\].
        needed_kib: u64,
    },
    /// The process's limit of open files is too low.
    #[error(
        "this process may open {allowed} files, it needs up to {needed}; raise the limit: `ulimit -n 1024`, or LimitNOFILE= of the service"
    )]
    Descriptors {
        /// Limit of open files \[-\].
        allowed: u64,
        /// Maximum number of files that the process needs \[-\].
        needed: u64,
    },
    /// Another process holds the lock of the instance.
    #[error(
        "{} is locked by a process that was stopped or hangs; find it with `fuser -v {}` and continue or end it",
        path.display(),
        path.display()
    )]
    Locked {
        /// The directory of the instance.
        path: PathBuf,
    },
    /// Name that cannot be part of a file name.
    #[error("{what} `{value}` cannot be used: {rule}")]
    Name {
        /// Kind of the name.
        what: &'static str,
        /// The name.
        value: String,
        /// Rule for such names.
        rule: &'static str,
    },
    /// The operating system or iceoryx2 refused.
    #[error("{action} failed: {reason}")]
    System {
        /// Action that failed.
        action: String,
        /// Reason as reported.
        reason: String,
    },
}

/// The operating system refused `action`.
pub(crate) fn system(action: impl Into<String>, reason: &dyn fmt::Display) -> BusError {
    BusError::System { action: action.into(), reason: reason.to_string() }
}

/// iceoryx2 refused `action`; its errors are names without a text.
pub(crate) fn of_iceoryx(action: impl Into<String>, error: &dyn fmt::Debug) -> BusError {
    let reason = format!(
        "iceoryx2 reports {error:?}: a file in the directory of the instance or in /dev/shm cannot be made, opened or read; \
         `oqtal doctor` examines both, and ending all processes of the instance removes them"
    );
    BusError::System { action: action.into(), reason }
}

impl BusError {
    /// The error of opening the file of `name` at `path` in shared memory.
    pub(crate) fn of_shared_file(name: &str, path: PathBuf, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::InvalidData => Self::Version { topic: name.to_owned() },
            io::ErrorKind::PermissionDenied => Self::Permission { path },
            io::ErrorKind::StorageFull => Self::full(1),
            _ => system(format!("opening {}", path.display()), error),
        }
    }

    /// Error for shared memory without room for a file of `needed_kib`.
    pub(crate) fn full(needed_kib: u64) -> Self {
        Self::Full { free_kib: free_kib().unwrap_or(0), needed_kib }
    }
}

/// Free shared memory \[KiB\]; `None` if the operating system does not report it.
pub(crate) fn free_kib() -> Option<u64> {
    let space = rustix::fs::statvfs("/dev/shm").ok()?;
    Some(space.f_bavail.saturating_mul(space.f_frsize) / 1024)
}

/// Remedy for a topic that another process writes: without the writers of most, a vehicle in flight falls.
fn how_to_end(topic: &str) -> &'static str {
    match topic {
        "reference" | "external" | "event" => "end that process first",
        _ => "a vehicle in flight falls if that process is ended: land it first",
    }
}
