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

    /// Files that were removed, with their instances; each file once.
    pub(crate) fn check(&self) -> Vec<(WatchedInstance, LostFile)> {
        let mut lost: Vec<(WatchedInstance, LostFile)> = Vec::new();
        for (instance, watch) in self.lock().iter_mut() {
            for file in watch.check() {
                if !lost.iter().any(|(_, known)| known.path == file.path) {
                    lost.push((instance.clone(), file));
                }
            }
        }
        lost
    }

    /// The watched instances other than `lost`.
    pub(crate) fn others(&self, lost: &WatchedInstance) -> Vec<WatchedInstance> {
        self.lock().iter().map(|(it, _)| it.clone()).filter(|it| it != lost).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<(WatchedInstance, InstanceWatch)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
