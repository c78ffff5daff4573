//! `oqtal info FILE`: contents of a recording; the flights of several.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use oqtal_observe::recording::{
    ListedFlight, RecordingFile, RecordingOverview, list, recording_path,
};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};
use serde::Serialize;

use crate::recordings;

/// Arguments of `oqtal info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// A recording: a file, one of its flights as FILE#NUMBER, the directory of a flight, or `latest`; or a directory with
    /// recordings, whose flights are listed
    #[arg(value_parser = listed_path)]
    file: PathBuf,
    /// Print the overview, or the list, as JSON
    #[arg(long)]
    json: bool,
}

/// Contents of a recording with its flights.
#[derive(Serialize)]
struct Contents {
    #[serde(flatten)]
    overview: RecordingOverview,
    flights: Vec<ListedFlight>,
}

/// Flights of one recording of a directory.
#[derive(Serialize)]
struct Listed {
    file: String,
    flights: Vec<ListedFlight>,
}

impl InfoArgs {
    /// Prints version, machine, configuration hash, flights and topics of the recording, or the flights of a directory.
    ///
    /// # Errors
    /// The file, or one of the directory, is not a recording (exit code 65) or of another version (76), or the directory has none (65).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let (text, exit) = match self.file.is_dir() {
            true => self.directory()?,
            false => (self.recording()?, Exit::Ok),
        };
        print(&text)?;
        Ok(exit)
    }

    fn recording(&self) -> Result<String, Failure> {
        let file = recordings::read(&self.file)?;
        let (overview, flights) = (RecordingOverview::of(&file), flights(&file)?);
        if self.json {
            return Ok(as_json(&Contents { overview, flights }));
        }
        let rows = [(file.path.display().to_string(), flights)];
        Ok(format!("{}\n\n{}", overview.to_text().trim_end(), list(&rows)))
    }

    /// The flights of all recordings below the directory, the oldest first. A file that cannot be read is named.
    fn directory(&self) -> Result<(String, Exit), Failure> {
        let mut files = Vec::new();
        collect(&self.file, 2, &mut files);
        if files.is_empty() {
            let message = format!("no recording (.mcap) in {}", self.file.display());
            return Err(Failure::new(Exit::Data, message));
        }
        files.sort();
        let (mut listed, mut exit) = (Vec::new(), Exit::Ok);
        for (_, path) in files {
            match recordings::read(&path).and_then(|file| flights(&file)) {
                Ok(flights) => listed.push(Listed { file: path.display().to_string(), flights }),
                Err(failure) => {
                    say(&format!("oqtal: {failure}"));
                    exit = failure.exit;
                }
            }
        }
        if self.json {
            return Ok((as_json(&listed), exit));
        }
        let rows: Vec<_> = listed.into_iter().map(|it| (it.file, it.flights)).collect();
        Ok((list(&rows), exit))
    }
}

/// The recording that `text` names, or a directory that is not that of one flight.
fn listed_path(text: &str) -> Result<PathBuf, String> {
    let path = recording_path(text)?;
    let directory = Path::new(text);
    Ok(if directory.is_dir() && !path.exists() { directory.to_path_buf() } else { path })
}

/// Adds the recordings in `directory`, and up to `depth` levels below it, with the times at which they were written.
fn collect(directory: &Path, depth: u32, files: &mut Vec<(SystemTime, PathBuf)>) {
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        let path = entry.path();
        // Links to directories are not followed.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            if depth > 0 {
                collect(&path, depth - 1, files);
            }
        } else if path.extension().is_some_and(|extension| extension == "mcap") {
            let written = entry.metadata().and_then(|file| file.modified());
            files.push((written.unwrap_or(SystemTime::UNIX_EPOCH), path));
        }
    }
}

fn flights(file: &RecordingFile) -> Result<Vec<ListedFlight>, Failure> {
    file.flights().map_err(recordings::failure)
}

fn as_json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("an overview is plain JSON")
}
