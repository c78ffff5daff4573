//! Reading of recordings for the commands that use them.

use std::path::{Path, PathBuf};

use oqtal_observe::flight::Flight;
use oqtal_observe::page::is_page;
use oqtal_observe::recording::{self, RecordingFile, RecordingFileError, RecordingResult};
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

/// Reads the recording at `path`, or one of its flights, `FILE#NUMBER`, and reports if it was cut off.
///
/// # Errors
/// The file cannot be read or is not a recording (exit code 65), or was recorded by another version (76).
pub fn read(path: &Path) -> Result<RecordingFile, Failure> {
    let file = recording::read(path).map_err(failure)?;
    if let Some(reason) = &file.cut_off {
        let messages = file.messages.len();
        say(&format!(
            "oqtal: {} is cut off ({reason}): {messages} messages were read",
            path.display()
        ));
    }
    Ok(file)
}

/// Reads the flight of the recording at `path`.
///
/// # Errors
/// Like [`read`]; or the recording has no tick of a daemon (65).
pub fn read_flight(path: &Path) -> Result<Flight, Failure> {
    let flight = recording::flight(&read(path)?).map_err(failure)?;
    if flight.samples.is_empty() {
        let message = format!(
            "{} has no tick of a daemon: nothing to show; `oqtal info` lists what it has",
            path.display()
        );
        return Err(Failure::new(Exit::Data, message));
    }
    Ok(flight)
}

/// `path` without extension, with the number of the flight that it names: names of results.
pub fn stem(path: &Path) -> PathBuf {
    let (file, number) = recording::numbered(path);
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    match number {
        Some(number) => file.with_file_name(format!("{name}-{number}")),
        None => file.with_extension(""),
    }
}

/// Requires that `path` names a whole recording.
///
/// # Errors
/// It names one flight of several (exit code 64): a replay needs everything from the start of the daemon on.
pub fn require_whole(path: &Path) -> Result<(), Failure> {
    match recording::numbered(path) {
        (_, None) => Ok(()),
        (file, Some(_)) => {
            let message = format!(
                "a replay needs the recording from the start of its daemon on: oqtal replay {}",
                file.display()
            );
            Err(Failure::new(Exit::Usage, message))
        }
    }
}

/// Requires that the recording at `path`, of `flight`, has at most one flight.
///
/// # Errors
/// It has several (exit code 64).
pub fn require_one(path: &Path, flight: &Flight) -> Result<(), Failure> {
    let count = if flight.is_observation() { 0 } else { flight.flights().count() };
    if count < 2 {
        return Ok(());
    }
    let file = path.display();
    let message = format!(
        "{file} has {count} flights: `oqtal info {file}` lists them, `{file}#1` to `{file}#{count}` name each of them"
    );
    Err(Failure::new(Exit::Usage, message))
}

/// The failure of a command for an error of a recording.
pub fn failure(error: RecordingFileError) -> Failure {
    let exit = if error.is_of_another_version() { Exit::Version } else { Exit::Data };
    Failure::new(exit, error.to_string())
}

/// Checks that a recording is complete.
///
/// # Errors
/// The recording ended early, messages are missing, or a file was removed (exit code 71).
pub fn check(recording: &RecordingResult) -> Result<(), Failure> {
    let RecordingResult { failure, dropped, files, removed, .. } = recording;
    if let Some(failure) = failure {
        return Err(Failure::new(
            Exit::System,
            format!("{failure}; free the disk, or record to another one with --out"),
        ));
    }
    if *dropped > 0 {
        let message = format!("{dropped} messages were not recorded: the disk is too slow");
        return Err(Failure::new(Exit::System, message));
    }
    let (gone, what) = match removed.first() {
        Some(removed) => (Some(removed), "was removed while it was recorded"),
        None => (files.iter().find(|path| !path.exists()), "was moved or removed"),
    };
    gone.map_or(Ok(()), |path| {
        Err(Failure::new(Exit::System, format!("{} {what}", path.display())))
    })
}

/// Whether `--out` names a directory: one that exists, a path that ends with a slash, or a new name without an extension.
pub fn is_directory(out: &Path) -> bool {
    let ends_with_slash = out.as_os_str().as_encoded_bytes().ends_with(b"/");
    let is_new_name = out.extension().is_none() && !out.exists();
    out.is_dir() || ends_with_slash || is_new_name
}

/// Path of the page: `out`, or `name` in `out` if that [is a directory](is_directory).
///
/// # Errors
/// A file is there that is not a page of oqtal, such as the recording itself (exit code 64).
pub fn page_path(out: &Path, name: &str) -> Result<PathBuf, Failure> {
    let path = if is_directory(out) { out.join(name) } else { out.to_owned() };
    // Pipes and devices are not read.
    let is_foreign = path.is_file() && !is_page(&path);
    if is_foreign {
        let message = format!(
            "{} exists and is not a page of oqtal, so it is not replaced; give another --out",
            path.display()
        );
        return Err(Failure::new(Exit::Usage, message));
    }
    Ok(path)
}

/// Writes a file of results; creates its directory if needed.
///
/// # Errors
/// The file is a recording (exit code 64), or cannot be written (71).
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> Result<(), Failure> {
    if path.is_file() && recording::is_recording(path) {
        let message =
            format!("{} is a recording, so it is not replaced; give another --out", path.display());
        return Err(Failure::new(Exit::Usage, message));
    }
    let directory = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    directory
        .and_then(|()| files::write(path, content))
        .map_err(|error| Failure::new(Exit::System, format!("{}: {error}", path.display())))
}
