//! The recording of a flight, `flight.mcap`.

use oqtal_lab::mission::Mission;
use oqtal_observe::recording::{McapRecorder, RecordingPlan};
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

use super::directory::FlightDirectory;
use crate::provenance::PROVENANCE;

/// Begins the recording of a flight; an older recording in the same directory is replaced.
///
/// # Errors
/// The file cannot be created.
pub fn begin(mission: &Mission, directory: &FlightDirectory) -> Result<McapRecorder, Failure> {
    let path = directory.recording();
    let failed = |error: std::io::Error| {
        let message = format!("{}: {error}; give another directory with --out", path.display());
        Failure::new(Exit::System, message)
    };
    files::remove(&path).map_err(failed)?;
    McapRecorder::create(&RecordingPlan {
        path: path.clone(),
        config: &mission.config,
        provenance: PROVENANCE,
        rotates: false,
        complain: |message| say(&format!("oqtal: {message}; the flight continues")),
    })
    .map_err(failed)
}
