//! Watches over the files of the instances that a process has joined.

use std::sync::{Arc, Mutex, PoisonError};

use oqtal_bus::watch::{InstanceWatch, LostFile};

/// Watches of the memberships of a process.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watches(Arc<Mutex<Vec<InstanceWatch>>>);

impl Watches {
    /// Adds the watch of a membership.
    pub(crate) fn add(&self, watch: InstanceWatch) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(watch);
    }

    /// Files that were removed; each file once.
    pub(crate) fn check(&self) -> Vec<LostFile> {
        let mut watches = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut lost: Vec<LostFile> = Vec::new();
        for file in watches.iter_mut().flat_map(InstanceWatch::check) {
            if !lost.iter().any(|known| known.path == file.path) {
                lost.push(file);
            }
        }
        lost
    }
}
