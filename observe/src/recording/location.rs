//! Names of recordings on the command line: a file, the directory of a flight, or `latest`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Name of the recording in the directory of a flight.
pub const RECORDING: &str = "flight.mcap";
/// Name of the last flight, unless a file has this name.
const LATEST: &str = "latest";
/// Directory of the flights, in the working directory.
const FLIGHTS: &str = "flights";

/// The recording that `text` names: `latest`, the newest one in `flights/`; the directory of a flight; or a file.
///
/// # Errors
/// `flights/` contains no recording.
pub fn recording_path(text: &str) -> Result<PathBuf, String> {
    let path = Path::new(text);
    if path.is_dir() {
        return Ok(path.join(RECORDING));
    }
    if text != LATEST || path.exists() {
        return Ok(path.to_path_buf());
    }
    newest(Path::new(FLIGHTS)).ok_or_else(|| {
        format!(
            "`{LATEST}` is the newest {FLIGHTS}/*/{RECORDING}, and this directory has none; fly first, or name a file"
        )
    })
}

/// The newest recording in the directories of `flights`.
fn newest(flights: &Path) -> Option<PathBuf> {
    let recordings =
        fs::read_dir(flights).ok()?.flatten().map(|entry| entry.path().join(RECORDING));
    let changed = |path: &PathBuf| fs::metadata(path).and_then(|file| file.modified()).ok();
    let dated = recordings.filter_map(|path| Some((changed(&path)?, path)));
    dated.max_by_key(|(changed, _): &(SystemTime, _)| *changed).map(|(_, path)| path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_recording_is_found_in_its_directory() {
        let flights = tempfile::tempdir().unwrap();
        assert_eq!(newest(flights.path()), None);
        for (age_s, name) in [(20, "default-2"), (10, "other-1"), (30, "default-10")] {
            let directory = flights.path().join(name);
            fs::create_dir(&directory).unwrap();
            let file = fs::File::create(directory.join(RECORDING)).unwrap();
            let written = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1000 - age_s);
            file.set_modified(written).unwrap();
        }
        fs::create_dir(flights.path().join("empty")).unwrap();
        let expected = flights.path().join("other-1").join(RECORDING);
        assert_eq!(newest(flights.path()), Some(expected.clone()));
        let directory = expected.parent().unwrap().display().to_string();
        assert_eq!(recording_path(&directory), Ok(expected));
        assert_eq!(recording_path("some.mcap"), Ok(PathBuf::from("some.mcap")));
    }
}
