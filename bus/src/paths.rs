//! Paths of an instance on this machine: directories, and the prefix of its names in shared memory.

use std::fs::DirEntry;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use iceoryx2::prelude::{Config, SemanticString};

use crate::error::{BusError, system};
use crate::message::{FNV_OFFSET, fnv1a, short_digits};
use crate::private;

/// Name of the link to an emulated vehicle in the directory of an instance.
pub(crate) const WIRE: &str = "wire";

/// Name of the socket of an external law in the directory of an instance.
pub(crate) const LAW: &str = "law";

/// Name of that socket until the daemon listens on it.
pub(crate) const LAW_UNREADY: &str = "law~";

/// Name of the socket at which a bridge lends its port, in the directory of an instance.
pub(crate) const CHAIN: &str = "chain";

/// Name of that socket until the bridge listens on it.
pub(crate) const CHAIN_UNREADY: &str = "chain~";

/// Name of the daemon's configuration in the directory of an instance.
pub(crate) const CONFIG: &str = "config.toml";

/// Root of the installed services.
const SYSTEM_ROOT: &str = "/run/oqtal";

/// Name and root directory of an instance. Buses with different paths are separate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InstancePaths {
    /// Name of the instance, `[a-z0-9-]{1,32}`.
    pub instance: String,
    /// Directory of all instances of this user.
    pub root: PathBuf,
}

impl InstancePaths {
    /// Paths of `instance`. The root is the first of: `root`, `/run/oqtal` if writable, `$XDG_RUNTIME_DIR/oqtal`,
    /// `/tmp/oqtal-UID`.
    ///
    /// # Errors
    /// The instance name is not `[a-z0-9-]{1,32}`.
    pub fn new(instance: &str, root: Option<&Path>) -> Result<Self, BusError> {
        let legal = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-';
        if !(1..=32).contains(&instance.len()) || !instance.bytes().all(legal) {
            return Err(BusError::Name {
                what: "instance",
                value: instance.to_owned(),
                rule: "use 1 to 32 of a-z, 0-9 and -",
            });
        }
        let root = root.map_or_else(default_root, Path::to_path_buf);
        Ok(Self { instance: instance.to_owned(), root })
    }

    /// Prefix of the names of this instance's files in shared memory; a random number follows in every name. It contains a hash
    /// of the root, because all roots share one shared memory. The prefix does not depend on the path by which an existing root
    /// is named.
    pub fn prefix(&self) -> String {
        format!("oqtal_{}_{}_", self.instance, short_digits(self.root_hash()))
    }

    /// Hash of the root; the same for each path by which a root, or the last existing directory above it, is named.
    pub fn root_hash(&self) -> u64 {
        let root = self.root.ancestors().find_map(|above| {
            let rest = self.root.strip_prefix(above).ok()?;
            // Without the separator that `join` adds to a path before an empty rest.
            Some(above.canonicalize().ok()?.join(rest).components().collect())
        });
        let root: PathBuf = root.unwrap_or_else(|| self.root.clone());
        fnv1a(FNV_OFFSET, root.as_os_str().as_encoded_bytes())
    }

    /// Roots that instances of this machine have by default: `/run/oqtal`, `/run/user/UID/oqtal`, `/tmp/oqtal-UID`.
    pub fn default_roots() -> Vec<PathBuf> {
        let entries = |of: &str| std::fs::read_dir(of).into_iter().flatten().flatten();
        let of_users = entries("/run/user").map(|user| user.path().join("oqtal"));
        let is_ours = |entry: &DirEntry| {
            let name = entry.file_name();
            name.to_str().is_some_and(|name| {
                name.strip_prefix("oqtal-").is_some_and(|user| user.parse::<u32>().is_ok())
            })
        };
        let temporary = entries("/tmp").filter(is_ours).map(|entry| entry.path());
        [PathBuf::from(SYSTEM_ROOT)].into_iter().chain(of_users).chain(temporary).collect()
    }

    /// Flags of a command that address the instance, for this user in this environment.
    pub fn flags(&self) -> String {
        let Self { instance, root } = self;
        // These settings would replace the default root.
        let sets_root = ["OQTAL_ROOT", "OQTAL_INSTANCE__ROOT"].map(std::env::var_os);
        let is_default = Self::new(instance, None).is_ok_and(|default| default == *self);
        match is_default && sets_root.iter().all(Option::is_none) {
            true => format!("--instance {instance}"),
            false => {
                format!("--instance {instance} --root {}", quoted(&root.display().to_string()))
            }
        }
    }

    /// Path of the shared words `name` of this instance.
    pub(crate) fn words_file(&self, name: &str) -> PathBuf {
        self.directory().join(private::LINK).join(name)
    }

    /// Directory of the instance.
    pub fn directory(&self) -> PathBuf {
        self.root.join(&self.instance)
    }

    /// Path of the link to an emulated vehicle of this instance. It is removed when the last process leaves.
    pub fn wire(&self) -> PathBuf {
        self.directory().join(WIRE)
    }

    /// Path of the socket of an external law of this instance. It is removed when the daemon ends, or the last process leaves.
    pub fn law(&self) -> PathBuf {
        self.directory().join(LAW)
    }

    /// Path of the socket at which a bridge of this instance lends its port. It is removed when the bridge ends, or the last process
    /// leaves.
    pub fn chain(&self) -> PathBuf {
        self.directory().join(CHAIN)
    }

    /// Path of the configuration with which the daemon of this instance was started. It is removed when the last process leaves.
    pub fn config(&self) -> PathBuf {
        self.directory().join(CONFIG)
    }

    /// Creates the root directory; returns an iceoryx2 configuration for the caller's own services in the directory of the instance. The
    /// files of a [`crate::bus::Bus`] are elsewhere: in the directory of its run.
    ///
    /// # Errors
    /// The directory cannot be made, or its path is not absolute or contains special characters.
    pub fn prepare(&self) -> Result<Config, BusError> {
        let mut root = self.directory().to_string_lossy().into_owned();
        root.push('/');
        let bad_root = || BusError::Name {
            what: "root",
            value: root.clone(),
            rule: "use an absolute path of plain characters, with the instance at most 200 long",
        };
        let path = iceoryx2::prelude::Path::new(root.as_bytes()).map_err(|_| bad_root())?;
        if !self.root.is_absolute() || root.len() > 200 {
            return Err(bad_root());
        }
        std::fs::create_dir_all(&self.root).map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied => {
                BusError::Permission { path: self.root.clone() }
            }
            _ => system(
                format!("creating {}", self.root.display()),
                &format_args!("{error}; give another --root"),
            ),
        })?;
        self.refuse_another_user()?;
        let mut config = Config::default();
        config.global.set_root_path(&path);
        Ok(config)
    }

    /// Changes the user of a process of root to the owner of the root directory, so that an operator's command does not need
    /// `sudo -u`. To be called before the process starts threads: only the calling thread and threads started later change their
    /// user.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn become_owner(&self) -> Result<(), BusError> {
        let Ok(root) = rustix::fs::stat(&self.root) else { return Ok(()) };
        if !rustix::process::geteuid().is_root() || root.st_uid == 0 {
            return Ok(());
        }
        // Printed commands are for the caller, who has another default.
        let _ = CALLERS_ROOT.set(default_root());
        let failed = |error: rustix::io::Errno| {
            system(format!("becoming the owner of {}", self.root.display()), &error)
        };
        let group = rustix::fs::Gid::from_raw(root.st_gid);
        rustix::thread::set_thread_groups(&[group]).map_err(failed)?;
        rustix::thread::set_thread_gid(group).map_err(failed)?;
        rustix::thread::set_thread_uid(rustix::fs::Uid::from_raw(root.st_uid)).map_err(failed)
    }

    /// User id of the owner of the instance's files, as whom a caller who is root must start its processes; `None` if the caller is not
    /// root, if root owns the files, or if the directory cannot be read.
    pub fn user_to_become(&self) -> Option<u32> {
        let is_root = CALLERS_ROOT.get().is_some() || rustix::process::geteuid().is_root();
        let owner = rustix::fs::stat(&self.root).ok().map(|root| root.st_uid);
        owner.filter(|owner| is_root && *owner != 0)
    }

    /// Refuses a root directory of another user. All processes of an instance must run as one user: another user, including root,
    /// would leave files that they cannot open, and iceoryx2 would report an internal error.
    fn refuse_another_user(&self) -> Result<(), BusError> {
        let failed = |error| system(format!("looking at {}", self.root.display()), &error);
        // A link in a world-writable directory can lead to any directory of this user.
        let link = rustix::fs::lstat(&self.root).map_err(failed)?;
        if link.st_uid != 0 && link.st_uid != rustix::process::geteuid().as_raw() {
            return Err(BusError::Permission { path: self.root.clone() });
        }
        let root = rustix::fs::stat(&self.root).map_err(failed)?;
        let ours = rustix::fs::Access::WRITE_OK | rustix::fs::Access::EXEC_OK;
        if root.st_uid == rustix::process::geteuid().as_raw()
            && rustix::fs::access(&self.root, ours).is_ok()
        {
            Ok(())
        } else {
            Err(BusError::Permission { path: self.root.clone() })
        }
    }
}

/// Default root of the caller of a process that became another user.
static CALLERS_ROOT: OnceLock<PathBuf> = OnceLock::new();

fn default_root() -> PathBuf {
    if let Some(root) = CALLERS_ROOT.get() {
        return root.clone();
    }
    let writable = |path: &Path| rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok();
    let run = Path::new(SYSTEM_ROOT);
    if writable(run) || (!run.exists() && writable(Path::new("/run"))) {
        return run.to_path_buf();
    }
    match std::env::var_os("XDG_RUNTIME_DIR") {
        Some(directory) if writable(Path::new(&directory)) => Path::new(&directory).join("oqtal"),
        _ => PathBuf::from(format!("/tmp/oqtal-{}", rustix::process::getuid().as_raw())),
    }
}

/// A word of a command line as a shell reads it.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flags_of_an_instance_name_its_root_unless_it_is_the_default() {
        let flags = |root| InstancePaths::new("opx1", root).unwrap().flags();
        assert_eq!(flags(None), "--instance opx1");
        assert_eq!(flags(Some(Path::new("/my run"))), "--instance opx1 --root '/my run'");
    }

    #[test]
    fn a_word_of_a_command_line_is_quoted_for_a_shell() {
        let words = ["--set", "fence.x-m=[-1, 1]", "it's", ""].map(quoted);
        assert_eq!(words, ["--set", "'fence.x-m=[-1, 1]'", r"'it'\''s'", "''"]);
    }
}
