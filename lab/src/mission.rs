//! What is to be flown: the configuration and what it names, read and checked.

use oqtal_bus::time::Span;
use oqtal_config::{Config, Vehicle};
use oqtal_control::trajectory::{FlightPlan, StartPoint, Trajectory};
use oqtal_mocap_emu::{Recording, read_recording};
use oqtal_observe::flight::Outcome;
use oqtal_runtime::process::{Exit, Failure};

/// Beyond its plan a flight may take this long, for the cameras to be believed and the landing to be noticed.
const GRACE_S: f64 = 15.0;

/// What a flight needs to know before it starts.
#[derive(Debug)]
pub struct Mission {
    /// The effective configuration.
    pub config: Config,
    /// What is flown.
    pub trajectory: Trajectory,
    /// What is played instead of the cameras, if anything.
    pub recording: Option<Recording>,
    /// What really flies, if it is not what the daemon believes: for studies of robustness, in one process only.
    pub plant: Option<Vehicle>,
}

impl Mission {
    /// Reads what the configuration names.
    ///
    /// # Errors
    /// A waypoint file or a recording is bad (exit code 65), or an option of the law has no meaning (78).
    pub fn new(config: Config) -> Result<Self, Failure> {
        oqtal_daemon::Pilot::new(&config).map_err(|reason| Failure::new(Exit::Config, reason))?;
        let trajectory = oqtal_daemon::trajectory(&config)?;
        let recording = match config.is_replay() {
            true => Some(read_recording(&config.mocap.replay)?),
            false => None,
        };
        Ok(Self { config, trajectory, recording, plant: None })
    }

    /// How long it takes if all goes well.
    #[must_use]
    pub fn expected(&self) -> Span {
        if let Some(recording) = &self.recording {
            let last = recording.poses().last().map_or(0, |pose| pose.time_ns);
            return Span::from_nanos(last.cast_signed());
        }
        let options = &self.config.trajectory;
        let plan = FlightPlan::new(options, self.trajectory.clone(), StartPoint::default());
        Span::from_seconds(plan.end_s())
    }

    /// How long it may take.
    #[must_use]
    pub fn patience(&self) -> Span {
        match self.recording {
            Some(_) => self.expected(),
            None => self.expected() + Span::from_seconds(GRACE_S),
        }
    }

    /// What a flight is called that did not end by itself.
    #[must_use]
    pub fn otherwise(&self) -> Outcome {
        if self.recording.is_some() { Outcome::Replayed } else { Outcome::Timeout }
    }
}
