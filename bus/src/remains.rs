//! Files that processes of an instance left behind, in its directory and in shared memory.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FallocateFlags, FlockOperation, Mode, OFlags, fallocate, flock};
use rustix::io::Errno;
use rustix::process::geteuid;

use crate::message::SHORT_DIGITS;

/// Directory of shared memory.
pub const SHARED_MEMORY: &str = "/dev/shm";

/// Path of the file or directory `name` in shared memory.
pub(crate) fn shared(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(name)
}

/// Maximum length read of a description \[bytes\]; the descriptions of iceoryx2 have some hundreds.
const LONGEST_DESCRIPTION: u64 = 1 << 16;

/// Time after which an empty object counts as left by a dead process.
const EMPTY_TIMEOUT: Duration = Duration::from_millis(100);

/// Objects of one run of an instance in shared memory.
#[derive(Debug)]
pub struct RunRemains {
    /// Name of the instance.
    pub instance: String,
    /// Beginning of the names of all objects of the run, and name of its private directory.
    pub name: String,
    /// The objects, and the private directory.
    pub objects: Vec<PathBuf>,
    memory: PathBuf,
}

impl RunRemains {
    /// Private directory of the run, which may have been removed.
    pub(crate) fn directory(&self) -> PathBuf {
        self.memory.join(&self.name)
    }

    /// Whether a process takes part in the run, by the lock on its private directory.
    pub fn is_alive(&self) -> bool {
        is_alive(&self.directory())
    }

    /// Removes the objects. An object that cannot be removed stays, like another user's.
    pub fn remove(&self) {
        // The directory last: its lock tells whether the run lives.
        let directory = self.directory();
        let (last, first): (Vec<_>, Vec<_>) =
            self.objects.iter().partition(|object| **object == directory);
        for object in first.into_iter().chain(last) {
            // A link is removed, not followed.
            let _ = fs::remove_file(object).or_else(|_| fs::remove_dir_all(object));
        }
    }
}

/// Runs with objects in the directory `memory` of shared memory whose names begin with `prefix`, of this user or others.
pub fn runs(memory: &Path, prefix: &str) -> Vec<RunRemains> {
    let mut runs: BTreeMap<String, RunRemains> = BTreeMap::new();
    for object in files(memory, prefix) {
        let name = object.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some((instance, run)) = run_of(&name) else { continue };
        let new = || RunRemains {
            instance: instance.to_owned(),
            name: run.to_owned(),
            objects: Vec::new(),
            memory: memory.to_path_buf(),
        };
        runs.entry(run.to_owned()).or_insert_with(new).objects.push(object);
    }
    runs.into_values().collect()
}

/// Name of the run in the name of an object, or in the path of one below the directory of shared memory.
pub fn run_name(object: &str) -> Option<&str> {
    run_of(object.split('/').next()?).map(|(_, run)| run)
}

/// Instance, and name of the run, in the name of an object: `oqtal_INSTANCE_ROOT_RANDOM...`. A name without a random number of a
/// run is a run of its own.
fn run_of(name: &str) -> Option<(&str, &str)> {
    let (instance, rest) = name.strip_prefix("oqtal_")?.split_once('_')?;
    let (_root, random) = rest.split_once('_')?;
    let end = name.len() - random.len() + SHORT_DIGITS;
    Some((instance, name.get(..end).unwrap_or(name)))
}

/// Removes the objects of all runs with this prefix that have no member.
pub(crate) fn remove_dead(prefix: &str) {
    for run in runs(SHARED_MEMORY.as_ref(), prefix) {
        if !run.is_alive() && !is_mapped(&run.name) {
            run.remove();
        }
    }
    // A process was killed before it gave its private directory a name.
    files(SHARED_MEMORY.as_ref(), &format!(".{prefix}")).into_iter().for_each(|unnamed| {
        let _ = fs::remove_dir(unnamed);
    });
}

/// Whether a process of this user has mapped an object of the run `name`, whose members may be alive although its directory was removed, or
/// replaced by another one of its name.
fn is_mapped(name: &str) -> bool {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let maps = processes.filter_map(|process| fs::read_to_string(process.path().join("maps")).ok());
    maps.into_iter().any(|maps| maps.contains(name))
}

/// Removes the objects of the run with the private directory `path`.
pub(crate) fn remove_run(path: &Path) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    runs(SHARED_MEMORY.as_ref(), &name).iter().for_each(RunRemains::remove);
}

/// Removes services that a process left incomplete: an unfinished description (static part), a description without administration
/// (dynamic part), or an administration without description. The caller holds the lock under which services are made, so no
/// service is being made at the moment.
pub(crate) fn remove_half_made(prefix: &str, run: &Path) {
    let descriptions = files(&run.join("services"), prefix);
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

/// Removes objects of size zero, left by a process that was killed before it set their size: the clean-up of iceoryx2 0.10 would wait for
/// them indefinitely. A living process sets the size within microseconds, without the lock; an object is removed only if it stays empty for
/// [`EMPTY_TIMEOUT`].
pub(crate) fn remove_empty(prefix: &str) {
    let empty = || -> Vec<(PathBuf, u64)> {
        let objects = files(Path::new(SHARED_MEMORY), prefix).into_iter();
        let looked = objects.filter_map(|path| Some((fs::symlink_metadata(&path).ok()?, path)));
        let empty = looked.filter(|(metadata, _)| metadata.is_file() && metadata.len() == 0);
        empty.map(|(metadata, path)| (path, metadata.ino())).collect()
    };
    let before = empty();
    if before.is_empty() {
        return;
    }
    std::thread::sleep(EMPTY_TIMEOUT);
    for (path, _) in empty().iter().filter(|object| before.contains(object)) {
        let _ = fs::remove_file(path);
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

/// Whether a process takes part in the run with this private directory.
pub(crate) fn is_alive(path: &Path) -> bool {
    open_directory(path)
        .is_ok_and(|lock| flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err())
}

/// Opens a directory of this user.
pub(crate) fn open_own_directory(path: &Path) -> Option<File> {
    let file = open_directory(path).ok()?;
    let is_own = file.metadata().ok()?.uid() == rustix::process::geteuid().as_raw();
    is_own.then_some(file)
}

/// Opens a directory without following a link.
pub(crate) fn open_directory(path: &Path) -> io::Result<File> {
    let flags = (OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
    OpenOptions::new().read(true).custom_flags(flags).open(path)
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
