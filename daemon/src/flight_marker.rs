//! A daemon that was killed, also by its watchdog, must not take off automatically after a restart. While a daemon that may take
//! off automatically runs, a file records its start; only an orderly end removes the file.

use std::fs::File;
use std::io::ErrorKind;
use std::path::PathBuf;

use oqtal_bus::paths::InstancePaths;
use oqtal_runtime::files;

/// The file of one instance.
#[derive(Debug)]
pub struct FlightMarker {
    path: PathBuf,
    instance: String,
}

impl FlightMarker {
    /// The marker of the instance at `place`.
    pub fn of(place: &InstancePaths) -> Self {
        let instance = place.instance.clone();
        Self { path: place.root.join(format!("{instance}.armed-at-start")), instance }
    }

    /// Sets the marker; `false` if it is there already, or cannot be made: then an operator has to arm.
    pub fn set(&self) -> bool {
        let (path, instance) = (self.path.display(), &self.instance);
        match File::create_new(&self.path) {
            Ok(_) => return true,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => tracing::warn!(
                "no take-off at start: the daemon before this one did not end in good order ({path}); arm with `oqtal ctl arm --instance {instance}`"
            ),
            Err(error) => {
                tracing::warn!(
                    "no take-off at start: {path}: {error}; arm with `oqtal ctl arm --instance {instance}`"
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
        assert!(marker.set());
        assert!(!marker.set(), "the daemon before was killed");
        assert!(!marker.set(), "and once more");
        marker.remove();
        assert!(marker.set());
    }
}
