//! Facts used by the checks.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, StatVfs, access, statvfs};

/// View of a machine: its files below a root folder, which tests replace, and facts that are not in files.
#[derive(Clone, Debug)]
pub struct System {
    /// Root folder of the files; `/` outside tests.
    pub root: PathBuf,
    /// Shared memory, total and free \[bytes\]; `None` if there is none.
    pub shared_memory: Option<(u64, u64)>,
    /// Directory of the instances' files.
    pub instances: PathBuf,
    /// Whether that directory can be written.
    pub instances_writable: bool,
    /// Free space of its file system \[bytes\]; `None` if unknown.
    pub instances_free: Option<u64>,
    /// Another user to whom that directory belongs; `None` if it is this user's, or does not exist.
    pub instances_owner: Option<u32>,
}

impl System {
    /// This machine, with the files of instances in `instances`.
    pub fn live(instances: &Path) -> Self {
        let space = statvfs("/dev/shm").ok();
        let free = |space: StatVfs| space.f_bavail * space.f_frsize;
        // A folder that does not exist yet is represented by its nearest existing ancestor.
        let standing = instances.ancestors().find(|ancestor| ancestor.exists());
        Self {
            root: PathBuf::from("/"),
            shared_memory: space.map(|space| (space.f_blocks * space.f_frsize, free(space))),
            instances: instances.to_path_buf(),
            instances_writable: standing.is_some_and(may_write),
            instances_free: standing.and_then(|standing| statvfs(standing).ok()).map(free),
            instances_owner: fs::metadata(instances)
                .map(|directory| directory.uid())
                .ok()
                .filter(|owner| *owner != rustix::process::geteuid().as_raw()),
        }
    }

    /// The content of a file without trailing line end; `None` if it cannot be read.
    pub fn read(&self, path: &str) -> Option<String> {
        let text = fs::read_to_string(self.root.join(path)).ok()?;
        Some(text.trim_end().to_owned())
    }

    /// Name of the user with this number, or else the number.
    pub fn user(&self, number: u32) -> String {
        let users = self.read("etc/passwd").unwrap_or_default();
        let fields = users.lines().map(|line| line.split(':').collect::<Vec<_>>());
        let known = |fields: &Vec<&str>| fields.get(2) == Some(&number.to_string().as_str());
        fields.into_iter().find(known).map_or_else(|| number.to_string(), |f| f[0].to_owned())
    }

    /// The sorted names in a folder; empty if it cannot be read.
    pub fn list(&self, path: &str) -> Vec<String> {
        let entries = fs::read_dir(self.root.join(path)).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Whether this user may read and write a file.
    pub fn may_use(&self, path: &str) -> bool {
        access(self.root.join(path), Access::READ_OK | Access::WRITE_OK).is_ok()
    }

    /// The value of `key` in a file of lines `key: value`.
    pub fn value(&self, path: &str, key: &str) -> Option<String> {
        let text = self.read(path)?;
        let line = text.lines().find_map(|line| line.strip_prefix(key)?.trim().strip_prefix(':'));
        line.map(|value| value.trim().to_owned())
    }

    /// Whether this process has a capability, by its number in `linux/capability.h`.
    pub fn has_capability(&self, number: u32) -> bool {
        let effective = self.value("proc/self/status", "CapEff").unwrap_or_default();
        u64::from_str_radix(&effective, 16).is_ok_and(|bits| bits >> number & 1 == 1)
    }

    /// A soft limit of this process, getrlimit(2); `None` for unlimited.
    pub fn limit(&self, name: &str) -> Option<u64> {
        let limits = self.read("proc/self/limits").unwrap_or_default();
        let line = limits.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("0");
        match line.split_whitespace().next() {
            Some("unlimited") => None,
            soft => Some(soft.and_then(|soft| soft.parse().ok()).unwrap_or(0)),
        }
    }
}

fn may_write(path: &Path) -> bool {
    access(path, Access::WRITE_OK).is_ok()
}
