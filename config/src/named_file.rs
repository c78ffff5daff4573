//! Files that a configuration names.

use std::path::{Path, PathBuf};

use oqtal_control::trajectory::TrajectoryKind;

use crate::config::Config;

impl Config {
    /// Makes the paths of files absolute: copies of a configuration are read in other directories.
    pub(crate) fn make_paths_absolute(&mut self) {
        // An empty path has no absolute path.
        let absolute = |path: &Path| std::path::absolute(path).ok();
        for path in [&mut self.mocap.replay, &mut self.bridge.mavlink.signing_key_file] {
            if let Some(whole) = absolute(Path::new(&*path)) {
                *path = whole.display().to_string();
            }
        }
        if let Some(path) = &mut self.trajectory.waypoints_file
            && let Some(whole) = absolute(path)
        {
            *path = whole;
        }
    }

    /// Replaces the paths of the files that a flight reads (waypoints, recording) using `place`. The path of a key file is not
    /// changed, since the key is a secret.
    ///
    /// # Errors
    /// The error of `place`.
    pub fn with_files_at<E>(
        mut self,
        mut place: impl FnMut(&Path) -> Result<PathBuf, E>,
    ) -> Result<Self, E> {
        if self.trajectory.kind == TrajectoryKind::Waypoints
            && let Some(file) = &mut self.trajectory.waypoints_file
        {
            *file = place(file)?;
        }
        if self.is_replay() {
            self.mocap.replay = place(Path::new(&self.mocap.replay))?.display().to_string();
        }
        Ok(self)
    }
}
