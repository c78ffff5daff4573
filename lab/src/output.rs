//! Output of a study: the output directory with its files and its journal, or one file. Results of another study are replaced only on
//! request. All results state their provenance: command line, program version and configuration.

use std::path::{Path, PathBuf};
use std::{fs, io};

use clap::Args;
use oqtal_config::Config;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use serde_json::{Value, json};

use crate::journal::{Journal, unwritable};
use crate::progress::Progress;
use crate::study::args::command;

/// Folder of the directories of studies.
const RESULTS: &str = "results";
/// File in the directory of a study that is in progress or was interrupted.
const JOURNAL: &str = "study.journal";
/// File with the configuration of the study.
pub const CONFIG: &str = "config.toml";

/// Arguments about results that the output of a study holds already.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct ExistingArgs {
    /// Continue an interrupted study: that of --out, or the last one with the same arguments in results/
    #[arg(long)]
    pub resume: bool,
    /// Replace results, or the part of an interrupted study, that --out holds already
    #[arg(long, requires = "out", conflicts_with = "resume")]
    pub force: bool,
}

/// Adds the provenance to a JSON document: command line, program version, and hash of `config`, the configuration that all flights
/// share.
pub fn add_provenance(document: &mut Value, config: &Config) {
    document["command"] = json!(command());
    document["version"] = json!(env!("CARGO_PKG_VERSION"));
    document["config_hash"] = json!(format!("{:016x}", config.hash()));
}

/// Beginning of the configuration that a study writes beside its results.
pub const STUDY_CONFIG_BEGINS: &str = "# Configuration of `";

/// `config` as a file, below comments with the command and the version of the program.
pub fn config_file_text(config: &Config) -> String {
    let (command, version) = (command(), env!("CARGO_PKG_VERSION"));
    format!("{STUDY_CONFIG_BEGINS}{command}`, oqtal {version}.\n{}", config.to_toml())
}

/// Output directory of a study, and its progress.
#[derive(Debug)]
pub struct StudyOutput {
    /// The directory.
    pub directory: PathBuf,
    /// Progress, kept in the journal.
    pub progress: Progress,
    /// Path of the journal.
    pub journal: PathBuf,
    /// Path of the copy of the configuration.
    copy: PathBuf,
    config: Config,
    /// Whether the directory was made for this study.
    is_new: bool,
}

impl StudyOutput {
    /// Creates the directory `given`, by default the first `results/COMMAND-N` that does not exist; the study of `config` will write
    /// `files` into it. To be resumed, the directory is that of an interrupted study, by default the newest one of `command` with the same
    /// arguments.
    ///
    /// # Errors
    /// The directory holds one of the files, one from which `config` was read, or an interrupted or running study, or there is none to
    /// resume (exit code 64); the directory cannot be made or written (71).
    pub fn begin(
        (command, config): (&str, &Config),
        given: Option<&Path>,
        files: &[impl AsRef<Path>],
        existing: ExistingArgs,
    ) -> Result<Self, Failure> {
        let directory = match (given, existing.resume) {
            (Some(directory), _) => directory.to_owned(),
            (None, true) => newest(command)?,
            (None, false) => next_free(command)?,
        };
        let is_new = given.is_none() && !existing.resume;
        make(&directory)?;
        let files: Vec<PathBuf> = files.iter().map(|name| directory.join(name)).collect();
        let own = [JOURNAL, CONFIG].map(|name| directory.join(name));
        let mut output = Self::open((directory, config), own, &files, existing)?;
        output.is_new = is_new;
        Ok(output)
    }

    /// Output into the directory of the first of `files`, with a journal and the configuration beside it, `NAME.journal` and
    /// `NAME.config.toml`.
    ///
    /// # Errors
    /// Like [`Self::begin`].
    pub fn beside(
        files: &[PathBuf],
        config: &Config,
        existing: ExistingArgs,
    ) -> Result<Self, Failure> {
        files.iter().try_for_each(|file| check_file(file))?;
        let directory = files[0].parent().unwrap_or(Path::new("")).to_owned();
        let own = ["journal", CONFIG].map(|extension| files[0].with_extension(extension));
        Self::open((directory, config), own, files, existing)
    }

    fn open(
        (directory, config): (PathBuf, &Config),
        [journal, copy]: [PathBuf; 2],
        files: &[PathBuf],
        existing: ExistingArgs,
    ) -> Result<Self, Failure> {
        if existing.resume
            && Journal::has_results(&journal)?
            && !Journal::has_these_arguments(&journal)
        {
            let reason = format!(
                "--resume: {} is of a study with other arguments; repeat its command with --resume, or give --force to begin again",
                journal.display()
            );
            return Err(Failure::new(Exit::Usage, reason));
        }
        if let Some(file) = files.iter().chain([&copy]).find(|file| config.is_from(file)) {
            let reason = format!(
                "{} is a configuration of this study, so it is not replaced; give another --out",
                file.display()
            );
            return Err(Failure::new(Exit::Usage, reason));
        }
        if !existing.resume && !existing.force {
            check_not_begun(&journal)?;
            check_free(files)?;
            check_free(std::slice::from_ref(&copy))?;
        }
        let opened = match existing.resume {
            true => Journal::resume(&journal)?,
            false => Journal::create(&journal)?,
        };
        let progress = Progress::kept_in(opened);
        Ok(Self { directory, progress, journal, copy, config: config.clone(), is_new: false })
    }

    /// Adds the provenance of this study to a JSON document.
    pub fn add_provenance(&self, document: &mut Value) {
        add_provenance(document, &self.config);
    }

    /// Completes the study, whose results are written: writes the configuration and removes the journal.
    ///
    /// # Errors
    /// A file cannot be written or removed (exit code 71).
    pub fn complete(&self) -> Result<(), Failure> {
        write_file(&self.copy, config_file_text(&self.config))?;
        self.discard()
    }

    /// Removes the journal.
    ///
    /// # Errors
    /// The file cannot be removed (exit code 71).
    pub fn discard(&self) -> Result<(), Failure> {
        files::remove(&self.journal).map_err(|error| unwritable(&self.journal, &error))
    }

    /// Writes a file into the directory.
    ///
    /// # Errors
    /// The file cannot be written (exit code 71).
    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> Result<(), Failure> {
        write(&self.directory, name, text)
    }
}

impl Drop for StudyOutput {
    /// Removes the directory of a study that was refused, or ended before its first result.
    fn drop(&mut self) {
        if self.is_new && Journal::is_empty(&self.journal) {
            // Ignored: the study itself is reported. A directory with files is not removed.
            let _ = self.discard().map(|()| fs::remove_dir(&self.directory));
        }
    }
}

/// Refuses to replace files that exist.
///
/// # Errors
/// One of the files exists (exit code 64).
pub fn check_free(files: &[PathBuf]) -> Result<(), Failure> {
    let Some(file) = files.iter().find(|file| file.is_file()) else { return Ok(()) };
    let reason = format!("{} exists already; give another --out, or --force", file.display());
    Err(Failure::new(Exit::Usage, reason))
}

/// Refuses to replace the journal of an interrupted study.
fn check_not_begun(journal: &Path) -> Result<(), Failure> {
    if !Journal::has_results(journal)? {
        return Ok(());
    }
    let reason = format!(
        "{} is of an interrupted study; continue it with --resume, or give another --out, or --force to begin again",
        journal.display()
    );
    Err(Failure::new(Exit::Usage, reason))
}

/// Creates the first `results/COMMAND-N` that does not exist.
///
/// # Errors
/// The directory cannot be made (exit code 71).
pub fn next_free(command: &str) -> Result<PathBuf, Failure> {
    let results = Path::new(RESULTS);
    make(results)?;
    files::create_numbered(results, command).map_err(|error| unwritable(results, &error))
}

/// The directory `results/COMMAND-N` with the highest number that has a journal of these arguments.
fn newest(command: &str) -> Result<PathBuf, Failure> {
    let entries = fs::read_dir(RESULTS).into_iter().flatten().flatten();
    let numbered = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let number: u32 = name.strip_prefix(command)?.strip_prefix('-')?.parse().ok()?;
        entry.path().join(JOURNAL).is_file().then(|| (number, entry.path()))
    });
    let (own, mut others): (Vec<_>, Vec<_>) =
        numbered.partition(|(_, path)| Journal::has_these_arguments(&path.join(JOURNAL)));
    others.sort();
    own.into_iter().max().map(|(_, directory)| directory).ok_or_else(|| {
        let others: Vec<String> =
            others.iter().map(|(_, path)| path.display().to_string()).collect();
        let others = match others.is_empty() {
            true => String::new(),
            false => format!(" with these arguments ({} had others)", others.join(", ")),
        };
        let reason = format!(
            "--resume: no interrupted {command} in {RESULTS}/{others}; give its directory with --out, or leave out --resume"
        );
        Failure::new(Exit::Usage, reason)
    })
}

/// Creates the directory. Called before a study, so that a failure is detected early.
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

/// Checks that `file` can be written, and keeps its content; to be called before a study, so that a failure is detected early. A file
/// that does not exist is not left behind.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn check_file(file: &Path) -> Result<(), Failure> {
    let is_new = file.symlink_metadata().is_err();
    make_parent(file)
        .and_then(|()| files::check_writable(file))
        .and_then(|()| if is_new { fs::remove_file(file) } else { Ok(()) })
        .map_err(|error| unwritable(file, &error))
}

fn make_parent(file: &Path) -> io::Result<()> {
    fs::create_dir_all(file.parent().unwrap_or(Path::new("")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESUME: ExistingArgs = ExistingArgs { resume: true, force: false };
    const FORCE: ExistingArgs = ExistingArgs { resume: false, force: true };

    #[test]
    fn results_and_an_interrupted_study_are_replaced_only_by_force() {
        let directory = tempfile::tempdir().unwrap();
        let out = directory.path().join("out");
        let config = Config::default();
        let of = ("study", &config);
        let begin = |existing| StudyOutput::begin(of, Some(&out), &["study.csv"], existing);
        let refused = || begin(ExistingArgs::default()).unwrap_err();
        // An interruption before the first result loses nothing.
        begin(ExistingArgs::default()).unwrap();
        let begun = begin(ExistingArgs::default()).unwrap();
        begun.progress.kept(1, |_| 7, Ok).unwrap();
        // A study that is in progress is refused as such: it has ended here.
        drop(begun);
        assert!(refused().to_string().contains("--resume"), "{}", refused());
        assert_eq!(refused().exit, Exit::Usage);
        begin(RESUME).unwrap();
        assert!(refused().to_string().contains("--resume"), "{}", refused());
        let again = begin(FORCE).unwrap();
        again.write("study.csv", "first").unwrap();
        again.complete().unwrap();
        let copy = fs::read_to_string(out.join(CONFIG)).unwrap();
        assert_eq!(Config::parse(CONFIG, &copy, &[]).unwrap(), config);
        assert!(copy.starts_with("# Configuration of `oqtal"), "{}", &copy[..80]);
        assert!(refused().to_string().contains("study.csv exists already"), "{}", refused());
        assert_eq!(refused().exit, Exit::Usage);
        begin(FORCE).unwrap().write("study.csv", "second").unwrap();
        fs::remove_file(out.join("study.csv")).unwrap();
        assert!(refused().to_string().contains("config.toml exists already"), "{}", refused());
    }

    #[test]
    fn output_into_a_file_that_exists_is_refused_and_the_check_leaves_no_file() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("new/table.csv");
        let files = std::slice::from_ref(&file);
        let beside = |existing| StudyOutput::beside(files, &Config::default(), existing);
        let output = beside(ExistingArgs::default()).unwrap();
        assert!(!file.exists());
        output.complete().unwrap();
        assert!(file.with_extension(CONFIG).exists());
        write_file(&file, "kept").unwrap();
        assert!(beside(ExistingArgs::default()).is_err());
        beside(FORCE).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "kept");
    }
}
