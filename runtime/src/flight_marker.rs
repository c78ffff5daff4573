//! Flight markers: files in the root of an instance that a daemon leaves to the next one. `NAME.armed-at-start` prevents an automatic
//! take-off after a Stop, and after a daemon was killed, by its watchdog or otherwise. It exists while a daemon that may take off
//! automatically runs, and is removed only by an orderly end without a stop that no `arm` has ended. `NAME.in-flight` exists during a
//! flight.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::PathBuf;

use oqtal_bus::paths::InstancePaths;

use crate::files;

/// The file of one instance.
#[derive(Debug)]
pub struct FlightMarker {
    path: PathBuf,
    /// Flags that address the instance.
    flags: String,
}

impl FlightMarker {
    /// The marker of the instance at `place`.
    pub fn of(place: &InstancePaths) -> Self {
        Self::named(place, "armed-at-start")
    }

    /// The marker of a flight under way at `place`, which a daemon that ends in flight leaves to the next one.
    pub fn in_flight(place: &InstancePaths) -> Self {
        Self::named(place, "in-flight")
    }

    fn named(place: &InstancePaths, name: &str) -> Self {
        let name = format!("{}.{name}", place.instance);
        Self { path: place.root.join(name), flags: place.flags() }
    }

    /// Whether the marker is set.
    pub fn is_set(&self) -> bool {
        // Also a link that leads nowhere, which keeps the file from being made.
        self.path.symlink_metadata().is_ok()
    }

    /// Sets the marker if it is not set; makes the root again if it was removed.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn ensure_set(&self) -> io::Result<()> {
        self.path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        match File::create_new(&self.path) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
            _ => Ok(()),
        }
    }

    /// Sets the marker for the daemon that begins; `false` if it is set already or cannot be created; an operator then has to arm.
    pub fn claim(&self) -> bool {
        let (path, flags) = (self.path.display(), &self.flags);
        match File::create_new(&self.path) {
            Ok(_) => return true,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => tracing::warn!(
                "no take-off at start: the daemon before this one was stopped, or did not end in good order ({path}); arm with `oqtal ctl arm {flags}`"
            ),
            Err(error) => {
                tracing::warn!(
                    "no take-off at start: {path}: {error}; arm with `oqtal ctl arm {flags}`"
                )
            }
        }
        false
    }

    /// Removes the marker, if it is there.
    pub fn remove(&self) {
        if let Err(error) = files::remove(&self.path) {
            tracing::warn!("{}: {error}; remove it before the next start", self.path.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_first_start_after_a_good_end_may_take_off_by_itself() {
        let directory = tempfile::tempdir().unwrap();
        let marker =
            FlightMarker::of(&InstancePaths::new("marker", Some(directory.path())).unwrap());
        marker.remove();
        assert!(marker.claim());
        assert!(!marker.claim(), "the daemon before was killed");
        assert!(!marker.claim(), "and once more");
        marker.remove();
        assert!(!marker.is_set() && marker.claim());
    }

    #[test]
    fn a_stop_sets_the_marker_also_where_it_is_set() {
        let directory = tempfile::tempdir().unwrap();
        let marker = FlightMarker::of(&InstancePaths::new("stop", Some(directory.path())).unwrap());
        for _ in 0..2 {
            marker.ensure_set().unwrap();
            assert!(marker.is_set());
        }
        assert!(!marker.claim(), "no take-off at start");
    }
}
