//! Where a bus lives on this machine.

use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, FileName, SemanticString};

use crate::error::{BusError, system};
use crate::message::{FNV_OFFSET, fnv1a};
use crate::wake::Events;

/// Where a bus lives: two buses with different places never hear each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InstancePaths {
    /// The instance, `[a-z0-9-]{1,32}`.
    pub instance: String,
    /// The directory of its service files.
    pub root: PathBuf,
    /// What wakes the processes that meet here.
    pub events: Events,
}

impl InstancePaths {
    /// A place for `instance`; the root is `root` if given, else `/run/oqtal` if writable, else `$XDG_RUNTIME_DIR/oqtal`,
    /// else `/tmp/oqtal-UID`.
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
        Ok(Self { instance: instance.to_owned(), root, events: Events::default() })
    }

    /// What the names of everything in this instance's shared memory begin with. The same instance under another root is
    /// another: its shared memory must not be taken for this one's. The root exists: by whichever path it is named, it counts
    /// as the same.
    #[must_use]
    pub fn prefix(&self) -> String {
        let root = self.root.canonicalize().unwrap_or_else(|_| self.root.clone());
        let root = fnv1a(FNV_OFFSET, root.as_os_str().as_encoded_bytes());
        format!("oqtal_{}_{root:016x}_", self.instance)
    }

    /// Makes the root directory, and iceoryx2's configuration for this place.
    ///
    /// # Errors
    /// The directory cannot be made, or its name is no absolute path of plain characters.
    pub fn prepare(&self) -> Result<Config, BusError> {
        let mut root = self.root.to_string_lossy().into_owned();
        if !root.ends_with('/') {
            root.push('/');
        }
        let bad_root = || BusError::Name {
            what: "root",
            value: root.clone(),
            rule: "use an absolute path of plain characters, at most 200 long",
        };
        let path = iceoryx2::prelude::Path::new(root.as_bytes()).map_err(|_| bad_root())?;
        if !self.root.is_absolute() || root.len() > 200 {
            return Err(bad_root());
        }
        std::fs::create_dir_all(&self.root).map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied => {
                BusError::Permission { path: self.root.clone() }
            }
            _ => system(format!("creating {}", self.root.display()), &error),
        })?;
        self.refuse_another_user()?;
        let mut config = Config::default();
        // Shared memory ignores the root path and files ignore the prefix: an instance needs both.
        config.global.set_root_path(&path);
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|_| bad_root())?;
        Ok(config)
    }

    /// Root becomes the user whose place this is, so that an operator's command needs no `sudo -u`. For such commands alone, before
    /// they start a thread: it is the calling thread that changes its user, and those that it starts.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn become_owner(&self) -> Result<(), BusError> {
        let Ok(root) = rustix::fs::stat(&self.root) else { return Ok(()) };
        if !rustix::process::geteuid().is_root() || root.st_uid == 0 {
            return Ok(());
        }
        let failed = |error: rustix::io::Errno| {
            system(format!("becoming the owner of {}", self.root.display()), &error)
        };
        let group = rustix::fs::Gid::from_raw(root.st_gid);
        rustix::thread::set_thread_groups(&[group]).map_err(failed)?;
        rustix::thread::set_thread_gid(group).map_err(failed)?;
        rustix::thread::set_thread_uid(rustix::fs::Uid::from_raw(root.st_uid)).map_err(failed)
    }

    /// Processes that meet here run as one user: another one, root included, would leave files that they cannot open. iceoryx2
    /// would call another user's directory an internal error.
    fn refuse_another_user(&self) -> Result<(), BusError> {
        let root = rustix::fs::stat(&self.root)
            .map_err(|error| system(format!("looking at {}", self.root.display()), &error))?;
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

fn default_root() -> PathBuf {
    let writable = |path: &Path| rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok();
    let run = Path::new("/run/oqtal");
    if writable(run) || (!run.exists() && writable(Path::new("/run"))) {
        return run.to_path_buf();
    }
    match std::env::var_os("XDG_RUNTIME_DIR") {
        Some(directory) if writable(Path::new(&directory)) => Path::new(&directory).join("oqtal"),
        _ => PathBuf::from(format!("/tmp/oqtal-{}", rustix::process::getuid().as_raw())),
    }
}
