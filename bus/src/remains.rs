//! Files that processes of an instance left behind: in its directory and in shared memory.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// Where shared memory has its names.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";

/// Directories of iceoryx2 in an instance's directory.
const DIRECTORIES: [&str; 2] = ["nodes", "services"];

/// Removes everything that belongs to an instance in which no process takes part. What cannot be removed is left: whoever opens
/// it says why.
pub(crate) fn remove_all(prefix: &str, directory: &Path) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        let _ = fs::remove_file(file);
    }
    for name in DIRECTORIES {
        let _ = fs::remove_dir_all(directory.join(name));
    }
}

/// Removes services that a process left half-made or half-removed: a description that is not finished, or one of description
/// (static part) and administration (dynamic part) without the other.
pub(crate) fn remove_half_made(prefix: &str, directory: &Path) {
    let descriptions = files(&directory.join("services"), prefix);
    let administrations: Vec<_> = files(Path::new(SHARED_MEMORY), prefix)
        .into_iter()
        .filter(|file| file.extension().is_some_and(|extension| extension == "dynamic"))
        .collect();
    let is_whole = |file: &PathBuf, others: &[PathBuf]| {
        is_finished(file)
            && others.iter().any(|other| other.file_stem() == file.file_stem() && is_finished(other))
    };
    let broken = |ours: &[PathBuf], others: &[PathBuf]| -> Vec<PathBuf> {
        ours.iter().filter(|file| !is_whole(file, others)).cloned().collect()
    };
    let (half, rest) =
        (broken(&descriptions, &administrations), broken(&administrations, &descriptions));
    for file in half.into_iter().chain(rest) {
        let _ = fs::remove_file(file);
    }
}

/// Takes the rights of other users away from iceoryx2's counter of nodes, which it makes writable for all.
pub(crate) fn make_private(prefix: &str) {
    for file in files(Path::new(SHARED_MEMORY), prefix) {
        if file.extension().is_some_and(|extension| extension == "global_mgmt") {
            // The file is ours; a file that has just gone needs no rights.
            let _ = fs::set_permissions(file, fs::Permissions::from_mode(0o600));
        }
    }
}

/// iceoryx2 marks by the permissions whether a file is finished: a description ends as readable only, an administration begins as
/// writable only.
fn is_finished(file: &Path) -> bool {
    let Ok(metadata) = fs::metadata(file) else { return false };
    let mode = metadata.permissions().mode() & 0o700;
    if file.extension().is_some_and(|extension| extension == "dynamic") {
        mode != 0o200
    } else {
        mode == 0o400
    }
}

fn files(directory: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|entry| entry.path()).collect()
}
