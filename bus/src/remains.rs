//! Files that processes of an instance left behind: in its directory and in shared memory.

use std::fs::{self, File};
use std::io::Read;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate};
use rustix::io::Errno;
use rustix::process::geteuid;

/// Directory of the names in shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// Path of the file or directory `name` in shared memory.
pub(crate) fn shared(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(name)
}

/// Length up to which a description is read \[bytes\]; those of iceoryx2 have some hundreds.
const LONGEST_DESCRIPTION: u64 = 1 << 16;

/// Directories of iceoryx2 in an instance's directory.
const DIRECTORIES: [&str; 2] = ["nodes", "services"];

/// Removes everything that belongs to an instance in which no process takes part. A file that cannot be removed stays: the
/// process that opens it reports the error.
pub(crate) fn remove_all(prefix: &str, directory: &Path) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        // Not followed, if it is a link.
        let _ = fs::remove_file(&file).or_else(|_| fs::remove_dir_all(file));
    }
    for name in DIRECTORIES {
        let _ = fs::remove_dir_all(directory.join(name));
    }
}

/// Removes services that a process left half-made or half-removed: an unfinished description (static part), a description without
/// administration (dynamic part), or an administration without description. The caller holds the lock under which services are
/// made, so no service is being made now.
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

/// Whether the owner's permissions are `mode`. iceoryx2 marks by them that a file is finished: a description ends as readable only,
/// an administration begins as writable only.
fn has_mode(file: &Path, mode: u32) -> bool {
    fs::symlink_metadata(file).is_ok_and(|metadata| metadata.permissions().mode() & 0o700 == mode)
}

/// Whether `administration` belongs to the service `id`, with which its name ends.
fn is_of(administration: &Path, id: u128) -> bool {
    let name = administration.file_stem().map(|stem| stem.to_string_lossy());
    name.and_then(|name| name.rsplit_once('_')?.1.parse().ok()) == Some(id)
}

/// Number of the service that a description, a TOML file of iceoryx2 0.10, is about: two halves of 64 bits.
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

/// Revokes other users' rights to iceoryx2's counter of nodes, which is made writable for all.
pub(crate) fn make_private(prefix: &str) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        if file.extension().is_some_and(|extension| extension == "global_mgmt") {
            // A file that has just gone needs no rights.
            let own = open_own(&file, OFlags::RDONLY);
            let _ = own.map(|own| own.set_permissions(fs::Permissions::from_mode(0o600)));
        }
    }
}

/// Allocates the memory of all files of the instance, which iceoryx2 makes without memory behind them: a process that touches such
/// a file when there is no memory left is killed by SIGBUS.
///
/// # Errors
/// There is no memory for a file of the returned size \[bytes\].
pub(crate) fn reserve_memory(prefix: &str) -> Result<(), u64> {
    for path in files(Path::new(SHARED_MEMORY), prefix) {
        // A connection may be gone again; one that cannot be opened yet is being made by its own process.
        let Some(file) = open_own(&path, OFlags::RDWR) else { continue };
        let Ok(metadata) = file.metadata() else { continue };
        let size = metadata.len();
        // Files in use have their memory: they are not touched.
        if metadata.blocks() * 512 < size
            && fallocate(&file, FallocateFlags::empty(), 0, size) == Err(Errno::NOSPC)
        {
            return Err(size);
        }
    }
    Ok(())
}

/// Opens a regular file of this user and of one name. All users see the names in shared memory: a file or link that another user
/// planted there is not opened.
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
