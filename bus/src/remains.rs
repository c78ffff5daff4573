//! Files that processes of an instance left behind, in its directory and in shared memory.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate};
use rustix::io::Errno;
use rustix::process::geteuid;

/// Directory of shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// Path of the file or directory `name` in shared memory.
pub(crate) fn shared(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(name)
}

/// Maximum length read of a description \[bytes\]; the descriptions of iceoryx2 have some hundreds.
const LONGEST_DESCRIPTION: u64 = 1 << 16;

/// Directories of iceoryx2 in an instance's directory.
const DIRECTORIES: [&str; 2] = ["nodes", "services"];

/// Removes all files of an instance without members. A file that cannot be removed stays: the process that opens it reports the
/// error.
pub(crate) fn remove_all(prefix: &str, directory: &Path) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        // A link is removed, not followed.
        let _ = fs::remove_file(&file).or_else(|_| fs::remove_dir_all(file));
    }
    for name in DIRECTORIES {
        let _ = fs::remove_dir_all(directory.join(name));
    }
}

/// Removes services that a process left incomplete: an unfinished description (static part), a description without administration
/// (dynamic part), or an administration without description. The caller holds the lock under which services are made, so no
/// service is being made at the moment.
pub(crate) fn remove_half_made(prefix: &str, directory: &Path) {
    let descriptions = files(&directory.join("services"), prefix);
    let administrations: Vec<_> = files(Path::new(SHARED_MEMORY), prefix)
        .into_iter()
        .filter(|file| file.extension().is_some_and(|extension| extension == "dynamic"))
        .collect();
    let mut described = Vec::new();
    for description in descriptions {
        let id = service_id(&description);
        let is_whole = id.is_some_and(|id| {
            administrations.iter().any(|file| is_of(file, id) && has_mode(file, 0o600))
        });
        if is_whole && has_mode(&description, 0o400) {
            described.extend(id);
        } else {
            let _ = fs::remove_file(description);
        }
    }
    for administration in administrations {
        if !described.iter().any(|id| is_of(&administration, *id)) {
            let _ = fs::remove_file(administration);
        }
    }
}

/// Whether the owner's permissions are `mode`. iceoryx2 marks finished files by permissions: a finished description is read-only,
/// an unfinished administration is write-only.
fn has_mode(file: &Path, mode: u32) -> bool {
    fs::symlink_metadata(file).is_ok_and(|metadata| metadata.permissions().mode() & 0o700 == mode)
}

/// Whether `administration` belongs to the service `id`: its name ends with the id.
fn is_of(administration: &Path, id: u128) -> bool {
    let name = administration.file_stem().map(|stem| stem.to_string_lossy());
    name.and_then(|name| name.rsplit_once('_')?.1.parse().ok()) == Some(id)
}

/// Service id in a description, a TOML file of iceoryx2 0.10: two halves of 64 bits.
fn service_id(description: &Path) -> Option<u128> {
    let mut text = String::new();
    let file = open_own(description, OFlags::RDONLY)?;
    file.take(LONGEST_DESCRIPTION).read_to_string(&mut text).ok()?;
    let half = |key: &str| -> Option<u128> {
        let mut lines = text.lines().filter_map(|line| line.split_once(" = "));
        lines.find(|(name, _)| *name == key)?.1.parse().ok()
    };
    Some(half("unique_value")? << 64 | half("payload_value")?)
}

/// Revokes other users' access to iceoryx2's node counter, which iceoryx2 makes world-writable.
pub(crate) fn make_private(prefix: &str) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        if file.extension().is_some_and(|extension| extension == "global_mgmt") {
            // The file may have just been removed.
            let own = open_own(&file, OFlags::RDONLY);
            let _ = own.map(|own| own.set_permissions(fs::Permissions::from_mode(0o600)));
        }
    }
}

/// Allocates the memory of all files of the instance. iceoryx2 makes them without memory allocated, and a process that accesses
/// such a file when memory is exhausted is ended by SIGBUS.
///
/// # Errors
/// There is no memory for a file of the returned size \[bytes\].
pub(crate) fn reserve_memory(prefix: &str) -> Result<(), u64> {
    for path in files(Path::new(SHARED_MEMORY), prefix) {
        // The connection may have been removed; one that cannot be opened yet is being made by another process.
        let Some(file) = open_own(&path, OFlags::RDWR) else { continue };
        let Ok(metadata) = file.metadata() else { continue };
        let size = metadata.len();
        // Files in use have their memory and are not changed.
        if metadata.blocks() * 512 < size
            && fallocate(&file, FallocateFlags::empty(), 0, size) == Err(Errno::NOSPC)
        {
            return Err(size);
        }
    }
    Ok(())
}

/// Opens a regular file of this user with a single name. All users see the names in shared memory; a file or link planted there
/// by another user is not opened.
fn open_own(path: &Path, access: OFlags) -> Option<File> {
    let flags = access | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = File::from(rustix::fs::open(path, flags, Mode::empty()).ok()?);
    let metadata = file.metadata().ok()?;
    let is_own = metadata.uid() == geteuid().as_raw() && metadata.nlink() == 1;
    (metadata.is_file() && is_own).then_some(file)
}

fn files(directory: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|entry| entry.path()).collect()
}
