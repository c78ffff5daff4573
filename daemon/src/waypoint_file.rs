//! The trajectory of a configuration, with its waypoint file read.

use oqtal_config::Config;
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::process::{Exit, Failure};

/// The trajectory of `config`.
///
/// # Errors
/// A waypoint file that cannot be read (exit code 65).
pub fn trajectory(config: &Config) -> Result<Trajectory, Failure> {
    let data = |reason: String| Failure::new(Exit::Data, reason);
    let options = &config.trajectory;
    let waypoints = match (&options.waypoints_file, options.kind) {
        (Some(file), TrajectoryKind::Waypoints) => {
            let name = file.display();
            let text =
                std::fs::read_to_string(file).map_err(|error| data(format!("{name}: {error}")))?;
            Some(Waypoints::parse(&text).map_err(|error| data(format!("{name}:{error}")))?)
        }
        _ => None,
    };
    options.trajectory(waypoints).ok_or_else(|| {
        let reason = "`trajectory.waypoints-file` must name a CSV file with columns t, x, y, z and, if wanted, yaw";
        Failure::new(Exit::Config, reason)
    })
}
