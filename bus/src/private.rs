//! The private part of shared memory of an instance. All users may make files in `/dev/shm`: another user could take a name that can be
//! guessed before the instance does.
//!
//! The first process of an instance draws a random number. Names of this run of the instance begin with it and [`SEPARATOR`]; a
//! directory of its owner alone, with the words that processes share, has it as its name. A link in the directory of the instance
//! leads there.

use std::fs::DirBuilder;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::os::unix::fs::{DirBuilderExt, symlink};
use std::path::Path;

use crate::error::{BusError, system};
use crate::remains;

/// Name of the link in the directory of an instance.
pub(crate) const LINK: &str = "shared";

/// Follows the random number in the names of iceoryx2, which refuses to list files if the name of one is its whole prefix: the
/// name of the private directory is without.
const SEPARATOR: char = '_';

/// Makes the private directory of the instance with this prefix and directory, and the link to it. To be called when no process takes
/// part, under the lock.
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

/// Prefix of the names of iceoryx2 in this run of the instance with this directory.
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
