//! Private part of shared memory of an instance. All users may make files in `/dev/shm`, so another user could occupy a
//! predictable name before the instance does.
//!
//! The first process of an instance draws a random number. Names of this run of the instance begin with it and [`SEPARATOR`]. It
//! is also the name of a directory that only its owner can access and that contains the shared words. A link in the directory of
//! the instance points to this directory.

use std::fs::DirBuilder;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::os::unix::fs::{DirBuilderExt, symlink};
use std::path::Path;

use crate::error::{BusError, system};
use crate::remains;

/// Name of the link in the directory of an instance.
pub(crate) const LINK: &str = "shared";

/// Separator after the random number in the names of iceoryx2, which refuses to list files if a name equals the prefix. The name
/// of the private directory has no separator.
const SEPARATOR: char = '_';

/// Makes the private directory of the instance with this prefix and directory, and the link to it. To be called under the lock
/// while the instance has no members.
///
/// # Errors
/// The operating system refuses.
pub(crate) fn make(prefix: &str, directory: &Path) -> Result<(), BusError> {
    let private = loop {
        let random = RandomState::new().hash_one(std::process::id());
        let path = remains::shared(&format!("{prefix}{random:016x}"));
        match DirBuilder::new().mode(0o700).create(&path) {
            Ok(()) => break path,
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(system(format!("creating {}", path.display()), &error)),
        }
    };
    let link = directory.join(LINK);
    let made = match std::fs::remove_file(&link) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => symlink(&private, &link),
    };
    made.map_err(|error| system(format!("linking {}", link.display()), &error))
}

/// Prefix of the names of iceoryx2 in the current run of the instance with this directory.
///
/// # Errors
/// The link to the private directory was removed.
pub(crate) fn prefix(directory: &Path) -> Result<String, BusError> {
    let link = directory.join(LINK);
    let failed = |reason: &dyn std::fmt::Debug| {
        system(
            format!("reading {} (remedy: end all processes of the instance)", link.display()),
            reason,
        )
    };
    let private = std::fs::read_link(&link).map_err(|error| failed(&error))?;
    let name = private.file_name().ok_or_else(|| failed(&private))?;
    Ok(format!("{}{SEPARATOR}", name.to_string_lossy()))
}
