//! Facts of a flight that are not in its messages, recorded at its end.

use super::facts::Facts;
use super::file::RecordingFile;
use crate::command_path::CommandPath;
use crate::flight::{Flight, Outcome};
use crate::kernel::ProcessUsage;

/// Name of the facts recorded at the end of a flight.
const FLIGHT: &str = "flight";

/// The facts of a flight that are not in its messages, as a table.
pub fn closing_facts(flight: &Flight) -> Facts {
    let known = [
        ("command_path", flight.command_path.to_string()),
        ("outcome", flight.outcome.to_string()),
        ("speed_factor", flight.speed_factor.to_string()),
        ("lost_requests", flight.lost_requests.to_string()),
    ];
    let json = |usage: &ProcessUsage| serde_json::to_string(usage).unwrap_or_default();
    let daemon = flight.daemon.as_ref().map(|usage| ("daemon", json(usage)));
    Facts::new(FLIGHT, known.into_iter().chain(daemon))
}

/// Removes these facts from `file`.
pub(super) fn remove(file: &mut RecordingFile) {
    file.facts.remove(FLIGHT);
}

/// The same facts as read from a recording; each is `None` if the recording does not contain it, for example because it is truncated.
#[derive(Clone, Debug)]
pub struct ClosingFacts {
    /// Path of the commands.
    pub command_path: Option<CommandPath>,
    /// Outcome of the flight.
    pub outcome: Option<Outcome>,
    /// Flight time over wall time \[-\].
    pub speed_factor: Option<f64>,
    /// Resource use of the daemon.
    pub daemon: Option<ProcessUsage>,
    /// Number of requests that are not in the record \[-\].
    pub lost_requests: u64,
}

impl ClosingFacts {
    /// Facts of the recording `file`.
    pub fn read(file: &RecordingFile) -> Self {
        let fact = |name| file.fact(FLIGHT, name);
        Self {
            command_path: fact("command_path").map(CommandPath::parse),
            outcome: fact("outcome").and_then(Outcome::parse),
            speed_factor: fact("speed_factor").and_then(|text| text.parse().ok()),
            lost_requests: fact("lost_requests").and_then(|it| it.parse().ok()).unwrap_or(0),
            daemon: fact("daemon").and_then(|text| serde_json::from_str(text).ok()),
        }
    }
}
