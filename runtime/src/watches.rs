//! Watches over the files of the instances that a process has joined.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use oqtal_bus::paths::InstancePaths;
use oqtal_bus::watch::{InstanceWatch, LostFile};

/// Watches of the memberships of a process.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watches(Arc<Mutex<Vec<(WatchedInstance, InstanceWatch)>>>);

/// An instance whose files are watched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WatchedInstance {
    pub(crate) name: String,
    /// Hash of its root, from before a loss: a link in the path of the root may be replaced.
    pub(crate) root_hash: u64,
}

impl Watches {
    /// Adds the watch of a membership of the instance at `paths`.
    pub(crate) fn add(&self, paths: &InstancePaths, watch: InstanceWatch) {
        let instance =
            WatchedInstance { name: paths.instance.clone(), root_hash: paths.root_hash() };
        self.lock().push((instance, watch));
    }

    /// Files that were removed; each file once.
    pub(crate) fn check(&self) -> Vec<LostFile> {
        let mut lost: Vec<LostFile> = Vec::new();
        for file in self.lock().iter_mut().flat_map(|(_, watch)| watch.check()) {
            if !lost.iter().any(|known| known.path == file.path) {
                lost.push(file);
            }
        }
        lost
    }

    /// The instances that are watched; each one once.
    pub(crate) fn instances(&self) -> Vec<WatchedInstance> {
        let mut instances: Vec<_> = self.lock().iter().map(|(it, _)| it.clone()).collect();
        instances.dedup();
        instances
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(WatchedInstance, InstanceWatch)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
