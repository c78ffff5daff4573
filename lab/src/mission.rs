//! Mission: the configuration of a flight and the files that it names, read and checked.

use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_control::trajectory::{FlightPlan, Trajectory};
use oqtal_mocap_emu::{Recording, read_recording};
use oqtal_observe::flight::Outcome;
use oqtal_runtime::process::Failure;

/// Time that a flight may take beyond its plan \[s\], until the first poses are accepted and the landing is detected.
const GRACE_S: f64 = 15.0;

/// Flight to be flown.
#[derive(Debug)]
pub struct Mission {
    /// Effective configuration.
    pub config: Config,
    /// Trajectory to fly.
    pub trajectory: Trajectory,
    /// Recording that is played in place of the cameras.
    pub recording: Option<Recording>,
}

impl Mission {
    /// Reads the files that `config` names.
    ///
    /// # Errors
    /// A waypoint file or a recording is malformed (exit code 65), an option of the law is invalid, or the trajectory cannot be
    /// flown (78).
    pub fn new(config: Config) -> Result<Self, Failure> {
        oqtal_daemon::require_stack(&config)?;
        let trajectory = oqtal_daemon::trajectory(&config)?;
        if !config.safety.observe_only {
            let start = oqtal_daemon::known_start(&config);
            let flyable = oqtal_daemon::require_flyable(&config, &trajectory, start);
            flyable.map_err(|failure| match first_outside(&config) {
                Some(at) => Failure::new(failure.exit, format!("{at}; {failure}")),
                None => failure,
            })?;
        }
        let recording = match config.is_replay() {
            true => Some(read_recording(&config.mocap.replay)?),
            false => None,
        };
        Ok(Self { config, trajectory, recording })
    }

    /// Planned duration of the flight.
    pub fn expected(&self) -> Span {
        if let Some(recording) = &self.recording {
            let last = recording.poses().last().map_or(0, |pose| pose.time_ns);
            return Span::from_nanos(last.cast_signed());
        }
        let options = &self.config.trajectory;
        let plan = FlightPlan::from_origin(options, &self.trajectory);
        Span::from_seconds(plan.end_s())
    }

    /// Greatest duration of the flight, after which it is ended.
    pub fn timeout(&self) -> Span {
        match self.recording {
            Some(_) => self.expected(),
            None => self.expected() + Span::from_seconds(GRACE_S),
        }
    }

    /// Outcome of a flight without a landing or crash.
    pub fn unfinished_outcome(&self) -> Outcome {
        match (&self.recording, self.config.safety.observe_only) {
            (Some(_), _) => Outcome::Replayed,
            (None, true) => Outcome::Observed,
            (None, false) => Outcome::Timeout,
        }
    }
}

/// File and line of the first waypoint outside the box of the fence, with the waypoint; `None` if there is none.
fn first_outside(config: &Config) -> Option<String> {
    let file = config.trajectory.waypoints_file.as_ref()?;
    let text = std::fs::read_to_string(file).ok()?;
    let names: Vec<&str> = text.lines().next()?.split(',').map(str::trim).collect();
    let columns = ["x", "y", "z"].map(|axis| names.iter().position(|name| *name == axis));
    let ranges = [config.fence.x_m, config.fence.y_m, config.fence.z_m];
    let point = |line: &str| -> Option<Vec<f64>> {
        let cells: Vec<&str> = line.split(',').collect();
        columns.iter().map(|column| cells.get((*column)?)?.trim().parse().ok()).collect()
    };
    let is_outside = |point: &[f64]| {
        point.iter().zip(ranges).any(|(value, [low, high])| *value < low || *value > high)
    };
    text.lines().enumerate().skip(1).find_map(|(index, line)| {
        let point = point(line).filter(|point| is_outside(point))?;
        let [x, y, z] = point[..] else { return None };
        let place = format!("{}:{}", file.display(), index + 1);
        Some(format!("{place}: the waypoint x = {x} m, y = {y} m, z = {z} m is outside [fence]"))
    })
}
