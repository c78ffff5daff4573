//! The trajectory of a configuration, with its waypoint file read.

use oqtal_config::{Config, read_text};
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::process::{Exit, Failure};

/// Length up to which a file is read \[MiB\].
const LONGEST_FILE_MIB: u64 = 16;

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
            let text = read_text(file, LONGEST_FILE_MIB)
                .map_err(|error| data(format!("{name}: {error}")))?;
            let parsed = Waypoints::parse(&text);
            Some(
                parsed
                    .map_err(|error| data(format!("{name}:{}: {}", error.line, error.problem)))?,
            )
        }
        _ => None,
    };
    options.trajectory(waypoints).ok_or_else(|| {
        let reason = "`trajectory.waypoints-file` must name a CSV file with columns t, x, y, z and, if wanted, yaw_deg";
        Failure::new(Exit::Config, reason)
    })
}
