//! The trajectory of a configuration, with its waypoint file read.

use std::path::PathBuf;
use std::slice;
use std::time::Duration;

use oqtal_config::{Config, read_waypoints, waypoints_comment};
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::process::{Exit, Failure};

use crate::refusal::Refusal;
use crate::timed_job::in_time;

/// Longest time in which a file that a request names is read.
const READ_TIMEOUT: Duration = Duration::from_millis(400);

/// Configuration key that names the waypoint file.
pub(crate) const WAYPOINTS_KEY: &str = "trajectory.waypoints-file";

/// The trajectory of `config`, whose waypoint file is read if it flies one.
///
/// # Errors
/// A waypoint file that cannot be read (exit code 65).
pub fn trajectory(config: &Config) -> Result<Trajectory, Failure> {
    let is_file = config.trajectory.kind == TrajectoryKind::Waypoints;
    let waypoints = if is_file { waypoints(config)? } else { None };
    trajectory_along(config, waypoints)
}

/// The trajectory of `config`, with these points if it flies waypoints.
///
/// # Errors
/// `config` flies waypoints, and none are given (exit code 78).
pub fn trajectory_along(
    config: &Config,
    waypoints: Option<Waypoints>,
) -> Result<Trajectory, Failure> {
    config.trajectory.trajectory(waypoints).ok_or_else(|| {
        let reason = "`trajectory.waypoints-file` must name a CSV file with columns t, x, y, z and, if wanted, yaw_deg";
        Failure::new(Exit::Config, reason)
    })
}

/// The points of the waypoint file of `config`; `None` if it names none.
///
/// # Errors
/// The file cannot be read (exit code 65).
pub fn waypoints(config: &Config) -> Result<Option<Waypoints>, Failure> {
    let Some(file) = &config.trajectory.waypoints_file else { return Ok(None) };
    let data = |reason: String| Failure::new(Exit::Data, reason);
    let name = file.display();
    let text = read_waypoints(file).map_err(|error| data(format!("{name}: {error}")))?;
    let parsed = Waypoints::parse(&text);
    parsed.map(Some).map_err(|error| data(format!("{name}:{}: {}", error.line, error.problem)))
}

/// Comment line of the waypoint file of `config`; empty without one.
fn comment(config: &Config) -> String {
    config.trajectory.waypoints_file.as_deref().map_or_else(String::new, waypoints_comment)
}

/// The result of `job`, which reads `files` for a request. A file that blocks would block this and every later request.
///
/// # Errors
/// One of the files exists and is not a regular file, they are not read in time, or `job` fails.
pub(crate) fn read_in_time<T, E>(
    files: &[PathBuf],
    job: impl FnOnce() -> Result<T, E> + Send + 'static,
) -> Result<T, Refusal>
where
    T: Send + 'static,
    Refusal: From<E>,
{
    let paths = files.to_owned();
    let is_other = |path: &&PathBuf| path.metadata().is_ok_and(|found| !found.is_file());
    let read = in_time(READ_TIMEOUT, move || match paths.iter().find(is_other) {
        Some(path) => {
            Err(Refusal::of_setting(format!("{}: not a regular file; give one", path.display())))
        }
        None => Ok(job()?),
    });
    read.unwrap_or_else(|reason| {
        let names: Vec<_> = files.iter().map(|file| file.display().to_string()).collect();
        Err(Refusal::of_setting(format!("{}: reading {reason}", names.join(", "))))
    })
}

/// Settings with the points of their waypoint file, so that a later change does not need the file, which may have been removed.
#[derive(Clone, Debug)]
pub(crate) struct ReadSettings {
    pub(crate) config: Config,
    /// Points of the waypoint file; `None` without a file, and for one that could not be read at the start.
    pub(crate) waypoints: Option<Waypoints>,
    /// Comment lines of the files that were read again in flight.
    pub(crate) reread: String,
    /// Comment line of the waypoint file, as it was read.
    pub(crate) waypoints_read: String,
}

impl ReadSettings {
    /// Like [`Self::reading`], without points if the file cannot be read: the request that needs them reports the error.
    pub(crate) fn at_start(config: &Config) -> Self {
        Self::reading(config.clone()).unwrap_or_else(|_| Self::along(config.clone(), None))
    }

    /// `config`, whose waypoint file is read.
    ///
    /// # Errors
    /// Like [`waypoints`].
    pub(crate) fn reading(config: Config) -> Result<Self, Failure> {
        // First: an edit from now on is told once too often, and never lost.
        let waypoints_read = comment(&config);
        let waypoints = waypoints(&config)?;
        Ok(Self { waypoints_read, ..Self::along(config, waypoints) })
    }

    /// `config` with these points of its waypoint file.
    pub(crate) fn along(config: Config, waypoints: Option<Waypoints>) -> Self {
        Self { config, waypoints, reread: String::new(), waypoints_read: String::new() }
    }

    /// The setting that names the waypoint file, as `KEY=VALUE`; `None` without a file.
    pub(crate) fn named_file(&self) -> Option<String> {
        self.config.value(WAYPOINTS_KEY).map(|file| format!("{WAYPOINTS_KEY}={file}"))
    }

    /// Whether `other` has the same settings and points; the files that were read again may differ.
    pub(crate) fn has_same_values(&self, other: &Self) -> bool {
        self.config == other.config && self.waypoints == other.waypoints
    }

    /// Whether `other` names the same file and has other points of it.
    pub(crate) fn has_other_points(&self, other: &Self) -> bool {
        let file = |settings: &Self| settings.config.trajectory.waypoints_file.clone();
        file(self) == file(other) && self.waypoints != other.waypoints
    }

    /// The trajectory. If its file could not be read at the start, it is read now.
    ///
    /// # Errors
    /// Like [`trajectory`] and [`read_in_time`].
    pub(crate) fn trajectory(&self) -> Result<Trajectory, Refusal> {
        match (&self.waypoints, &self.config.trajectory.waypoints_file) {
            (None, Some(file)) if self.config.trajectory.kind == TrajectoryKind::Waypoints => {
                let config = self.config.clone();
                read_in_time(slice::from_ref(file), move || trajectory(&config))
            }
            (points, _) => Ok(trajectory_along(&self.config, points.clone())?),
        }
    }
}
