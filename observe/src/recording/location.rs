//! Names of recordings on the command line: a file, the directory of a flight, or `latest`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use oqtal_bus::topic::Sample;

use super::file::RecordingFile;
use super::playback::play;
use crate::sink::{Reception, Sink};

/// Name of the recording in the directory of a flight.
pub const RECORDING: &str = "flight.mcap";
/// Name of the summary in the directory of a flight.
pub const SUMMARY: &str = "summary.json";
/// Name of the last flight, unless a file has this name.
const LATEST: &str = "latest";
/// Directory of the flights, in the working directory.
const FLIGHTS: &str = "flights";

/// The recording that `text` names: `latest`, that of the last flight in `flights/` that flew; the directory of a flight; or a
/// file.
///
/// # Errors
/// No flight in `flights/` flew, or the last one that did was not recorded.
pub fn recording_path(text: &str) -> Result<PathBuf, String> {
    let path = Path::new(text);
    if path.is_dir() {
        return Ok(path.join(RECORDING));
    }
    if text != LATEST || path.exists() {
        return Ok(path.to_path_buf());
    }
    latest(Path::new(FLIGHTS))
}

/// The recording of the last flight in the directories of `flights` that flew.
fn latest(flights: &Path) -> Result<PathBuf, String> {
    let Some(flight) = newest_first(flights).into_iter().find(|flight| has_flown(flight)) else {
        return Err(format!(
            "`{LATEST}` is the last flight in {FLIGHTS}/ that flew, and this directory has none; fly first, or name a file"
        ));
    };
    let recording = flight.join(RECORDING);
    if recording.exists() {
        return Ok(recording);
    }
    Err(format!(
        "`{LATEST}` is {}, which was flown without a recording: `fly --clock in-process` records only with --set record.flights=all; \
         fly again with it, or name an earlier flight",
        flight.display()
    ))
}

/// Directories of flights: the one written last first; of those written in the same instant the one with the highest number.
fn newest_first(flights: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(flights).into_iter().flatten().flatten();
    let mut dated: Vec<(SystemTime, u32, PathBuf)> = entries
        .filter_map(|entry| {
            let flight = entry.path();
            let written = |name: &str| fs::metadata(flight.join(name)).and_then(|f| f.modified());
            // A recording ends with its flight; a summary can be written again.
            let written = written(RECORDING).or_else(|_| written(SUMMARY)).ok()?;
            Some((written, number(&flight), flight))
        })
        .collect();
    dated.sort();
    dated.into_iter().rev().map(|(.., flight)| flight).collect()
}

/// The number at the end of the name of `flight`; 0 without one.
fn number(flight: &Path) -> u32 {
    let name = flight.file_name().unwrap_or_default().to_string_lossy();
    name.rsplit('-').next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

/// Whether the vehicle flew: by the recording, which the flight of a killed program has, too, or else by the summary.
fn has_flown(flight: &Path) -> bool {
    let recording = flight.join(RECORDING);
    if recording.exists() {
        let mut flown = Flown(false);
        let file = RecordingFile::read(&recording);
        return file.is_ok_and(|file| play(&file, &mut flown).is_ok() && flown.0);
    }
    let summary = fs::read_to_string(flight.join(SUMMARY)).unwrap_or_default();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap_or_default();
    summary["duration_s"].as_f64().is_some_and(|duration_s| duration_s > 0.0)
}

/// Whether a tick of a flight was seen.
struct Flown(bool);

impl Sink for Flown {
    fn sample(&mut self, _: &Reception, sample: Sample<'_>) {
        if let Sample::Telemetry(tick) = sample {
            // Without motors the trajectory is held at its beginning.
            self.0 |= tick.is_armed() && tick.mission_s > 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Writes the summary of a flight of this duration at this instant \[s\].
    fn fly(flights: &Path, name: &str, duration_s: f64, written_s: u64) {
        let directory = flights.join(name);
        fs::create_dir(&directory).unwrap();
        let summary = directory.join(SUMMARY);
        fs::write(&summary, format!("{{\"duration_s\": {duration_s}}}")).unwrap();
        let file = fs::File::options().append(true).open(&summary).unwrap();
        file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(written_s)).unwrap();
    }

    #[test]
    fn the_last_flight_that_flew_is_found_by_time_and_number() {
        let flights = tempfile::tempdir().unwrap();
        let flights = flights.path();
        assert!(latest(flights).unwrap_err().contains("has none"));
        for (name, duration_s, written_s) in [
            ("default-2", 9.0, 980),
            ("default-9", 9.0, 990),
            ("default-10", 9.0, 990),
            ("default-11", 0.0, 991),
            ("other-12", 9.0, 970),
        ] {
            fly(flights, name, duration_s, written_s);
        }
        fs::create_dir(flights.join("default-12")).unwrap();
        let order: Vec<_> =
            newest_first(flights).into_iter().map(|flight| number(&flight)).collect();
        assert_eq!(order, [11, 10, 9, 2, 12]);
        let unrecorded = latest(flights).unwrap_err();
        assert!(unrecorded.contains("default-10") && unrecorded.contains("record.flights=all"));
        // A recording of nothing.
        let empty = flights.join("default-12").join(RECORDING);
        fs::write(&empty, "").unwrap();
        assert!(latest(flights).unwrap_err().contains("default-10"));
        let directory = empty.parent().unwrap().display().to_string();
        assert_eq!(recording_path(&directory), Ok(empty));
        assert_eq!(recording_path("some.mcap"), Ok(PathBuf::from("some.mcap")));
    }
}
