//! Watches the files of a living instance: detects files that were removed, and restores those that can be restored.
//!
//! The file `members` and the link to the private directory are created again in the directory of the instance, as long as that directory
//! has its name; another directory of this name belongs to another run. Shared words and files of iceoryx2 cannot be restored for the
//! processes that have mapped them: these processes keep them, but no process can join. The members, also those that do not use the lost
//! file, then end the flight and leave, and the next process starts a new run of the instance.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use crate::member_files::{MEMBERS, Members, acquire};
use crate::private::{self, InstanceRun, is_same};
use crate::time::{Span, Time};
use crate::{remains, shared, stop, wake};

/// Maximum time for which a repair waits for the lock of the instance.
const REPAIR_TIMEOUT: Span = Span::from_millis(100);

/// File of a living instance that was removed, moved or shortened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LostFile {
    /// Path of the file.
    pub path: PathBuf,
    /// Whether the file, or its size, was restored. Otherwise no process can join this run of the instance.
    pub is_restored: bool,
}

/// Watch over the files of one membership.
#[derive(Debug)]
pub struct InstanceWatch {
    directory: PathBuf,
    /// The directory, open: it may lose its name.
    home: File,
    run: InstanceRun,
    members: Members,
    /// Files that were missing at the last check.
    missing: Vec<PathBuf>,
}

impl InstanceWatch {
    pub(crate) fn new(
        (directory, home): (PathBuf, File),
        run: InstanceRun,
        members: Members,
    ) -> Self {
        Self { directory, home, run, members, missing: Vec::new() }
    }

    /// Files that were removed, moved or shortened, of those that this process uses, and one whose loss another process recorded. A file
    /// in use counts if it was missing at the last check, too: it may be one that this process is just closing.
    pub fn check(&mut self) -> Vec<LostFile> {
        let mut lost = Vec::new();
        let places = [
            (&self.directory, is_same(&self.home, &self.directory)),
            (&self.run.path, self.run.is_present()),
        ];
        let absent = places.into_iter().filter(|(_, is_present)| !is_present);
        let mut missing: Vec<_> = absent.map(|(path, _)| path.clone()).collect();
        if missing.is_empty() {
            lost.extend(self.restore());
        }
        missing.extend(removed_files(std::process::id(), &self.run.path));
        let removed = missing.iter().filter(|path| self.missing.contains(path));
        let mut removed: Vec<_> = removed.cloned().collect();
        match removed.first() {
            // Not a failed repair: it may be this process that fails.
            Some(path) => private::record_loss(&self.run.path, path),
            None => removed.extend(private::loss(&self.run.path)),
        }
        lost.extend(removed.into_iter().map(|path| LostFile { path, is_restored: false }));
        lost.extend(self.restore_sizes());
        let shortened = shared::take_shortened().into_iter();
        lost.extend(shortened.map(|(path, is_restored)| LostFile { path, is_restored }));
        self.missing = missing;
        lost
    }

    /// Creates `members` and the link again if they are missing.
    fn restore(&self) -> Vec<LostFile> {
        let link = self.directory.join(crate::private::LINK);
        let (members, linked) =
            (self.members.are_present(&self.directory), self.run.is_linked(&self.directory));
        let mut lost = Vec::new();
        if members && linked {
            return lost;
        }
        // A handle of its own: its lock excludes this process's other threads as well.
        let Some(lock) = remains::open_own_directory(&self.directory) else { return lost };
        if acquire(&lock, &self.directory, Time::now() + REPAIR_TIMEOUT).is_err()
            || !is_same(&self.home, &self.directory)
        {
            // Tried again at the next check.
            return lost;
        }
        if !linked {
            // A link to another run belongs to processes that joined after this run had been lost.
            let is_restored =
                fs::symlink_metadata(&link).is_err() && self.run.link(&self.directory).is_ok();
            lost.push(LostFile { path: link, is_restored });
        }
        if !members && lost.iter().all(|file| file.is_restored) {
            let is_restored = self.members.join(&self.directory).is_ok();
            lost.push(LostFile { path: self.directory.join(MEMBERS), is_restored });
        }
        lost
    }

    /// Restores the size of shared words, since no process opens words of another size.
    fn restore_sizes(&self) -> Vec<LostFile> {
        let entries = fs::read_dir(&self.run.path).into_iter().flatten().flatten();
        let restore = |path: PathBuf| {
            let words = if path.ends_with(stop::FILE) { stop::WORDS } else { wake::WORDS };
            let is_restored = shared::restore_size(&path, words).ok()?;
            is_restored.then_some(LostFile { path, is_restored })
        };
        entries.filter_map(|entry| restore(entry.path())).collect()
    }
}

/// Removed files of the run with the private directory `run` that the process `pid` has open: shared words, and files of iceoryx2.
/// Connections, and the memory of another process, which is open for reading, may disappear before this process closes them.
pub(crate) fn removed_files(pid: u32, run: &Path) -> Vec<PathBuf> {
    let objects = run.as_os_str().as_encoded_bytes();
    let entries = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    let removed = entries.filter_map(|entry| {
        let link = fs::read_link(entry.path()).ok()?;
        let path = PathBuf::from(link.to_str()?.strip_suffix(" (deleted)")?);
        let is_ours = path.as_os_str().as_encoded_bytes().starts_with(objects);
        (is_ours && !is_of_peer(&path, &entry.path(), pid)).then_some(path)
    });
    removed.collect()
}

/// Whether `path`, open as `descriptor`, is a file that another process may remove while `pid` has it open. Descriptors of ports are
/// inherited from a process that started it.
fn is_of_peer(path: &Path, descriptor: &Path, pid: u32) -> bool {
    if path.iter().any(|part| process_of_node(part).is_some_and(|id| id != pid)) {
        return true;
    }
    let extension = path.extension().unwrap_or_default();
    let is_writable =
        || fs::symlink_metadata(descriptor).is_ok_and(|link| mode(&link) & 0o200 != 0);
    extension == "connection" || (extension == "data" && !is_writable())
}

/// Process of the node of iceoryx2 whose directory has the name `part`: its number is in the third quarter of the 128 bits.
fn process_of_node(part: &OsStr) -> Option<u32> {
    let node: u128 = part.to_str()?.parse().ok()?;
    u32::try_from((node >> 64) & u128::from(u32::MAX)).ok().filter(|id| *id != 0)
}

fn mode(metadata: &fs::Metadata) -> u32 {
    std::os::unix::fs::PermissionsExt::mode(&metadata.permissions())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_of_the_process_that_started_this_one_is_not_missed() {
        let node = |process: u32| (u128::from(process) << 64) | 38_968;
        let path = |process| PathBuf::from(format!("/run/a/nodes/{}/port.port_tag", node(process)));
        let descriptor = Path::new("/proc/self/fd/0");
        assert!(!is_of_peer(&path(7), descriptor, 7));
        assert!(is_of_peer(&path(8), descriptor, 7));
    }
}
