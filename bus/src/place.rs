//! Where a bus lives on this machine.

use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, FileName, SemanticString};

use crate::error::BusError;
use crate::wake::Events;

/// Where a bus lives: two buses with different places never hear each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The instance, `[a-z0-9-]{1,32}`.
    pub instance: String,
    /// The directory of its service files.
    pub root: PathBuf,
    /// What wakes the processes that meet here.
    pub events: Events,
}

impl Place {
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

    /// What the names of everything in this instance's shared memory begin with.
    pub(crate) fn prefix(&self) -> String {
        format!("oqtal_{}_", self.instance)
    }

    /// iceoryx2's configuration for this place.
    pub(crate) fn config(&self) -> Result<Config, BusError> {
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
        let mut config = Config::default();
        // Shared memory ignores the root path and files ignore the prefix: an instance needs both.
        config.global.set_root_path(&path);
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|_| bad_root())?;
        Ok(config)
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
