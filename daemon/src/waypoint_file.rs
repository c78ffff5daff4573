//! The trajectory of a configuration, with its waypoint file read.

use oqtal_config::{Config, read_waypoints};
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::process::{Exit, Failure};

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

/// Settings with the points of their waypoint file: a later change does not depend on the file, which may have vanished.
#[derive(Clone, Debug)]
pub(crate) struct ReadSettings {
    pub(crate) config: Config,
    /// `None` without a file, and for one that could not be read at the start.
    pub(crate) waypoints: Option<Waypoints>,
    /// Comment lines of the files that were read again in flight.
    pub(crate) reread: String,
}

impl ReadSettings {
    /// Whether `other` has the same settings and points; the files that were read again may differ.
    pub(crate) fn has_same_values(&self, other: &Self) -> bool {
        self.config == other.config && self.waypoints == other.waypoints
    }

    /// Whether `other` names the same file and has other points of it.
    pub(crate) fn has_other_points(&self, other: &Self) -> bool {
        let file = |settings: &Self| settings.config.trajectory.waypoints_file.clone();
        file(self) == file(other) && self.waypoints != other.waypoints
    }

    /// The trajectory. A file that could not be read at the start is an error of the request that flies it.
    ///
    /// # Errors
    /// As [`trajectory`].
    pub(crate) fn trajectory(&self) -> Result<Trajectory, Failure> {
        match &self.waypoints {
            Some(points) => trajectory_along(&self.config, Some(points.clone())),
            None => trajectory(&self.config),
        }
    }
}
