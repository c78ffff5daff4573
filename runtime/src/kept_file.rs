//! Files of a running process in the directory of its instance, by which other processes find it. A removed file is created again.

use std::io;
use std::path::{Path, PathBuf};

use oqtal_bus::time::{Span, Time};

use crate::files::{self, identity};

/// Time between two checks of a file.
const CHECK_PERIOD: Span = Span::from_millis(300);

/// A file that is created again if it is missing, in the directory in which it was created. A file that another process has put in its
/// place is kept.
#[derive(Debug)]
pub struct KeptFile {
    path: PathBuf,
    /// Device and inode of the directory: another directory of this name belongs to another run.
    directory: Option<(u64, u64)>,
    /// Device and inode of the file as it was last made, or found at the start.
    file: Option<(u64, u64)>,
    /// Reason of the last attempt to make the file, if it failed.
    failure: Option<String>,
    /// Instant of the next check.
    next: Time,
}

impl KeptFile {
    /// The file at `path`, which is not made yet.
    pub fn new(path: PathBuf) -> Self {
        let (directory, file) = (directory_of(&path), identity(&path));
        Self { path, directory, file, failure: None, next: Time::UNSET }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Creates the file with `make`, and records its identity.
    ///
    /// # Errors
    /// The error of `make`.
    pub fn make<T>(&mut self, make: impl FnOnce(&Path) -> io::Result<T>) -> io::Result<T> {
        let made = make(&self.path)?;
        self.file = identity(&self.path);
        Ok(made)
    }

    /// Creates the file as [`KeptFile::make`]. `report` receives a line if the file had been removed, if it cannot be created for a
    /// new reason, and when it is created after failures.
    pub fn renew<T>(
        &mut self,
        make: impl FnOnce(&Path) -> io::Result<T>,
        report: impl FnOnce(&str),
    ) -> Option<T> {
        let was_removed = self.file.is_some() && identity(&self.path).is_none();
        let result = self.make(make);
        let (path, before) = (self.path.display(), self.failure.take());
        match result {
            Ok(made) => {
                if before.is_some() {
                    report(&format!("{path} was created after earlier failures"));
                } else if was_removed {
                    report(&format!("{path} was removed while in use; it was created again"));
                }
                Some(made)
            }
            Err(error) => {
                let reason = error.to_string();
                if before.as_ref() != Some(&reason) {
                    let removed = if was_removed { " was removed, and" } else { "" };
                    report(&format!("{path}{removed} cannot be created: {reason}; retrying"));
                }
                self.failure = Some(reason);
                None
            }
        }
    }

    /// Whether the file must be created again at `now`, because it is missing or could not be created. Checked every 300 ms.
    pub fn is_due(&mut self, now: Time) -> bool {
        if now < self.next {
            return false;
        }
        self.next = now + CHECK_PERIOD;
        let found = identity(&self.path);
        let is_due = found.is_none() || found == self.file && self.failure.is_some();
        is_due && self.directory.is_some() && directory_of(&self.path) == self.directory
    }

    /// Removes the file, unless another process has made one of its own in its place.
    pub fn remove(&self) {
        files::remove_same(&self.path, self.file);
    }
}

fn directory_of(path: &Path) -> Option<(u64, u64)> {
    path.parent().and_then(identity)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Checks `file` at the number `second`; returns whether it is made, and the line.
    fn check(file: &mut KeptFile, second: i64, full: bool) -> (bool, String) {
        let mut line = String::new();
        let make = |path: &Path| match full {
            true => Err(io::ErrorKind::StorageFull.into()),
            false => fs::write(path, "ours"),
        };
        let now = Time::VIRTUAL_START + Span::from_millis(1000 * second);
        let is_made =
            file.is_due(now) && file.renew(make, |told| told.clone_into(&mut line)).is_some();
        let name = file.path().display().to_string();
        (is_made, line.replace(&name, "it"))
    }

    #[test]
    fn a_removed_file_is_made_again_in_its_directory_and_another_one_stays() {
        let root = tempfile::tempdir().unwrap();
        let home = root.path().join("home");
        fs::create_dir(&home).unwrap();
        let mut file = KeptFile::new(home.join("socket"));
        let mut second = 0..;
        let mut check = |file: &mut KeptFile| check(file, second.next().unwrap(), false);
        file.make(|path| fs::write(path, "ours")).unwrap();
        let nothing = (false, String::new());
        assert_eq!(check(&mut file), nothing);
        for _ in 0..2 {
            fs::remove_file(file.path()).unwrap();
            let told = "it was removed while in use; it was created again";
            assert_eq!(check(&mut file), (true, told.to_owned()));
            assert_eq!(check(&mut file), nothing);
        }
        fs::write(home.join("theirs"), "theirs").unwrap();
        fs::rename(home.join("theirs"), file.path()).unwrap();
        assert_eq!(check(&mut file), nothing, "another file");
        file.remove();
        assert_eq!(fs::read_to_string(file.path()).unwrap(), "theirs");
        fs::rename(&home, root.path().join("moved")).unwrap();
        assert_eq!(check(&mut file), nothing, "no directory");
        fs::create_dir(&home).unwrap();
        assert_eq!(check(&mut file), nothing, "the directory of another run");
    }

    #[test]
    fn a_full_disk_is_reported_once_and_its_end_once() {
        let home = tempfile::tempdir().unwrap();
        for was_there in [false, true] {
            let mut file = KeptFile::new(home.path().join("config.toml"));
            if was_there {
                fs::remove_file(file.path()).unwrap();
            }
            let mut second = 0..;
            let mut check = |full| check(&mut file, second.next().unwrap(), full);
            let removed = if was_there { " was removed, and" } else { "" };
            let told = format!("it{removed} cannot be created: no storage space; retrying");
            assert_eq!(check(true), (false, told));
            for _ in 0..3 {
                assert_eq!(check(true), (false, String::new()));
            }
            assert_eq!(check(false), (true, "it was created after earlier failures".to_owned()));
            assert_eq!(check(true), (false, String::new()), "it is there");
        }
    }
}
