//! Output of a study: the output directory with its files and its journal, or one file.

use std::path::{Path, PathBuf};
use std::{fs, io};

use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};

use crate::journal::Journal;
use crate::progress::Progress;

/// Folder of the directories of studies.
const RESULTS: &str = "results";
/// Highest number of a directory `results/COMMAND-N`.
const MAX_NUMBER: u32 = 100_000;
/// File in the directory of a study that is in progress or was interrupted.
const JOURNAL: &str = "study.journal";

/// Output directory of a study, and its progress.
#[derive(Debug)]
pub struct StudyOutput {
    /// The directory.
    pub directory: PathBuf,
    /// Progress, kept in the journal.
    pub progress: Progress,
    /// Path of the journal.
    pub journal: PathBuf,
}

impl StudyOutput {
    /// Makes the directory `given`, by default the first `results/COMMAND-N` that does not exist. With `resume` the directory is
    /// that of an interrupted study, by default the newest one of `command`.
    ///
    /// # Errors
    /// There is no interrupted study (exit code 64), or the directory cannot be made or written (71).
    pub fn begin(command: &str, given: Option<&Path>, resume: bool) -> Result<Self, Failure> {
        let directory = match (given, resume) {
            (Some(directory), _) => directory.to_owned(),
            (None, true) => newest(command)?,
            (None, false) => next_free(command)?,
        };
        make(&directory)?;
        let journal = directory.join(JOURNAL);
        Self::open(directory, journal, resume)
    }

    /// Output into the directory of `file`, with a journal beside it, `NAME.journal`.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn beside(file: &Path, resume: bool) -> Result<Self, Failure> {
        check_file(file)?;
        let directory = file.parent().unwrap_or(Path::new("")).to_owned();
        Self::open(directory, file.with_extension("journal"), resume)
    }

    fn open(directory: PathBuf, journal: PathBuf, resume: bool) -> Result<Self, Failure> {
        let opened = if resume { Journal::resume(&journal)? } else { Journal::create(&journal)? };
        Ok(Self { directory, progress: Progress::kept_in(opened), journal })
    }

    /// Writes a file into the directory.
    ///
    /// # Errors
    /// The file cannot be written (exit code 71).
    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> Result<(), Failure> {
        write(&self.directory, name, text)
    }
}

/// Removes the journal of a complete study.
///
/// # Errors
/// The file cannot be removed (exit code 71).
pub fn complete(journal: &Path) -> Result<(), Failure> {
    match fs::remove_file(journal) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(unwritable(journal, &error)),
        _ => Ok(()),
    }
}

/// Makes the first `results/COMMAND-N` that does not exist.
///
/// # Errors
/// The directory cannot be made (exit code 71).
pub fn next_free(command: &str) -> Result<PathBuf, Failure> {
    make(Path::new(RESULTS))?;
    for number in 1..MAX_NUMBER {
        let directory = Path::new(RESULTS).join(format!("{command}-{number}"));
        match fs::create_dir(&directory) {
            Ok(()) => return Ok(directory),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(unwritable(&directory, &error)),
        }
    }
    let reason = format!("{RESULTS}/ has no free number; remove old results, or give --out");
    Err(Failure::new(Exit::System, reason))
}

/// The directory `results/COMMAND-N` with the highest number that has a journal.
fn newest(command: &str) -> Result<PathBuf, Failure> {
    let entries = fs::read_dir(RESULTS).into_iter().flatten().flatten();
    let numbered = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let number: u32 = name.strip_prefix(command)?.strip_prefix('-')?.parse().ok()?;
        entry.path().join(JOURNAL).is_file().then(|| (number, entry.path()))
    });
    let newest = numbered.max().map(|(_, directory)| directory);
    newest.ok_or_else(|| {
        let reason = format!(
            "--resume: no interrupted {command} in {RESULTS}/; give its directory with --out, or leave out --resume"
        );
        Failure::new(Exit::Usage, reason)
    })
}

/// Makes the directory; to be called before a study, so that a failure is detected early.
///
/// # Errors
/// The directory cannot be made (exit code 71).
pub fn make(directory: &Path) -> Result<(), Failure> {
    fs::create_dir_all(directory).map_err(|error| unwritable(directory, &error))
}

/// Writes a file into the directory, which is made if it does not exist.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn write(directory: &Path, name: &str, text: impl AsRef<[u8]>) -> Result<(), Failure> {
    write_file(&directory.join(name), text)
}

/// Writes a file; its directory is made if it does not exist.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn write_file(file: &Path, text: impl AsRef<[u8]>) -> Result<(), Failure> {
    make_parent(file)
        .and_then(|()| files::write(file, text))
        .map_err(|error| unwritable(file, &error))
}

/// Checks that `file` can be written, and keeps its content; to be called before a study, so that a failure is detected early.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn check_file(file: &Path) -> Result<(), Failure> {
    make_parent(file)
        .and_then(|()| files::check_writable(file))
        .map_err(|error| unwritable(file, &error))
}

fn make_parent(file: &Path) -> io::Result<()> {
    fs::create_dir_all(file.parent().unwrap_or(Path::new("")))
}

fn unwritable(path: &Path, error: &io::Error) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}; give another --out", path.display()))
}
