//! Facts of a flight that are not in its messages, recorded at its end.

use super::facts::Facts;
use super::file::RecordingFile;
use crate::command_path::CommandPath;
use crate::flight::{Flight, Outcome};
use crate::kernel::ProcessUsage;

/// Name of the facts recorded at the end of a flight.
const FLIGHT: &str = "flight";

/// Facts of a flight that are not in its messages.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClosingFacts {
    /// Path of the commands; `None` if the recording does not contain it.
    pub command_path: Option<CommandPath>,
    /// Outcome of the flight.
    pub outcome: Option<Outcome>,
    /// Flight time over wall time \[-\].
    pub speed_factor: Option<f64>,
    /// Resource use of the daemon.
    pub daemon: Option<ProcessUsage>,
}

impl ClosingFacts {
    /// The facts of a flight.
    pub fn of(flight: &Flight) -> Self {
        Self {
            command_path: Some(flight.command_path.clone()),
            outcome: Some(flight.outcome),
            speed_factor: Some(flight.speed_factor),
            daemon: flight.daemon.clone(),
        }
    }

    /// The facts as a table.
    pub fn to_facts(&self) -> Facts {
        let json = |daemon: &ProcessUsage| serde_json::to_string(daemon).unwrap_or_default();
        let facts = [
            ("command_path", self.command_path.as_ref().map(ToString::to_string)),
            ("outcome", self.outcome.map(|outcome| outcome.to_string())),
            ("speed_factor", self.speed_factor.map(|factor| factor.to_string())),
            ("daemon", self.daemon.as_ref().map(json)),
        ];
        let known = facts.into_iter().filter_map(|(name, fact)| Some((name, fact?)));
        Facts::new(FLIGHT, known)
    }

    /// Facts of a recording; the defaults for a truncated one.
    pub fn read(file: &RecordingFile) -> Self {
        let fact = |name| file.fact(FLIGHT, name);
        Self {
            command_path: fact("command_path").map(CommandPath::parse),
            outcome: fact("outcome").and_then(Outcome::parse),
            speed_factor: fact("speed_factor").and_then(|text| text.parse().ok()),
            daemon: fact("daemon").and_then(|text| serde_json::from_str(text).ok()),
        }
    }
}
