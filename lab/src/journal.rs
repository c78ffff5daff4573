//! Journal of a study: the results so far, so that an interrupted study can be resumed.
//!
//! A line of JSON for each result; the first line identifies the program and the arguments of the study. The file is locked as
//! long as the study runs.

use std::collections::HashMap;
use std::fs::{self, File, TryLockError};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::study::args::command;

/// One result as a line of the file.
#[derive(Serialize, Deserialize)]
struct JournalLine {
    key: u64,
    kept: Value,
}

/// Journal of a study.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
    kept: HashMap<u64, KeptResult>,
    /// Whether the file has a result.
    has_result: AtomicBool,
}

/// Result from before an interruption, and whether the resumed study used it.
#[derive(Debug)]
struct KeptResult {
    value: Value,
    is_used: AtomicBool,
}

impl Journal {
    /// An empty journal in the file `path`, which is replaced.
    ///
    /// # Errors
    /// The file is of a study that is running (exit code 64), or cannot be written (71).
    pub fn create(path: &Path) -> Result<Self, Failure> {
        Self::begin(path, &locked(path)?)
    }

    fn begin(path: &Path, file: &File) -> Result<Self, Failure> {
        let head = format!("{} {}\n", program(), own_arguments());
        let begun = file.set_len(0).and_then(|()| {
            let mut file = file.try_clone()?;
            file.rewind()?;
            file.write_all(head.as_bytes())?;
            Ok(file)
        });
        let file = begun.map_err(|error| unwritable(path, &error))?;
        Ok(Self::of(path, file))
    }

    fn of(path: &Path, file: File) -> Self {
        let (path, file) = (path.to_owned(), Mutex::new(file));
        Self { path, file, kept: HashMap::new(), has_result: AtomicBool::new(false) }
    }

    /// The journal in the file `path`, with the results of an interrupted study. A line that was not written to its end is left out.
    ///
    /// # Errors
    /// The file does not exist, was written by another build of the program, or is of a study that is running (exit code 64); it cannot
    /// be written (71).
    pub fn resume(path: &Path) -> Result<Self, Failure> {
        let usage = |reason: &str| {
            let reason = format!(
                "--resume: {}: {reason}; to fly the study from its beginning, give another --out, or --force",
                path.display()
            );
            Failure::new(Exit::Usage, reason)
        };
        fs::metadata(path).map_err(|_| usage("no interrupted study"))?;
        let mut file = locked(path)?;
        let text = fs::read_to_string(path).map_err(|_| usage("no interrupted study"))?;
        let text = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        let (head, lines) = text.split_once('\n').unwrap_or((text, ""));
        if head.rsplit_once(' ').is_none_or(|(of, _)| of != program()) {
            return Err(usage("flown by another build of this program"));
        }
        let line = |line| serde_json::from_str::<JournalLine>(line).ok();
        let lines: Vec<JournalLine> = lines.lines().filter_map(line).collect();
        // The head of a journal without results may have other arguments.
        if lines.is_empty() {
            return Self::begin(path, &file);
        }
        // Only the torn line is removed: the others stay in the file at any time.
        let end = text.len() as u64;
        let cut = file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end)));
        cut.map_err(|error| unwritable(path, &error))?;
        let mut journal = Self::of(path, file);
        journal.has_result = AtomicBool::new(true);
        let kept = |JournalLine { key, kept: value }| {
            (key, KeptResult { value, is_used: AtomicBool::new(false) })
        };
        journal.kept = lines.into_iter().map(kept).collect();
        Ok(journal)
    }

    /// Whether `path` is a journal with a result, of any build of the program.
    ///
    /// # Errors
    /// It is of a study that is running (exit code 64).
    pub fn has_results(path: &Path) -> Result<bool, Failure> {
        let Ok(text) = fs::read_to_string(path) else { return Ok(false) };
        locked(path)?;
        Ok(has_results(&text))
    }

    /// Whether `path` is a journal without results.
    pub fn is_empty(path: &Path) -> bool {
        fs::read_to_string(path).is_ok_and(|text| !has_results(&text))
    }

    /// Whether `path` is a journal of a study with the arguments of this one.
    pub fn has_these_arguments(path: &Path) -> bool {
        let own = own_arguments();
        let text = fs::read_to_string(path).unwrap_or_default();
        text.lines().next().is_some_and(|head| head.ends_with(&own))
    }

    /// Number of results before the study was interrupted \[-\].
    pub fn resumed(&self) -> usize {
        self.kept.len()
    }

    /// Number of them that [`Self::find`] has returned \[-\].
    pub fn used(&self) -> usize {
        self.kept.values().filter(|result| result.is_used.load(Ordering::Relaxed)).count()
    }

    /// Result with this key from before the interruption; `None` if there is none of this type.
    pub fn find<T: DeserializeOwned>(&self, key: u64) -> Option<T> {
        let KeptResult { value, is_used } = self.kept.get(&key)?;
        let found = T::deserialize(value).ok()?;
        is_used.store(true, Ordering::Relaxed);
        Some(found)
    }

    /// Adds a result.
    ///
    /// # Errors
    /// The file cannot be written (exit code 71).
    pub fn keep(&self, key: u64, result: &impl Serialize) -> Result<(), Failure> {
        let kept = serde_json::to_value(result).expect("a result is plain JSON");
        let line = serde_json::to_string(&JournalLine { key, kept }).expect("a line is plain JSON");
        let mut file = self.file.lock().expect("no holder of this lock panics");
        file.write_all(format!("{line}\n").as_bytes())
            .map_err(|error| unwritable(&self.path, &error))?;
        self.has_result.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// Whether the file has a result.
    pub fn has_result(&self) -> bool {
        self.has_result.load(Ordering::Relaxed)
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Journal {
    /// Prints the number of results from before an interruption that were used.
    fn drop(&mut self) {
        if self.resumed() > 0 {
            let (used, all) = (self.used(), self.resumed());
            say(&format!("resumed: {used} of {all} results of the interrupted study were used"));
        }
    }
}

/// The file `path`, locked until it is closed.
fn locked(path: &Path) -> Result<File, Failure> {
    let file = files::open(path).map_err(|error| unwritable(path, &error))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let reason = "of a study that is running; wait for its end, or give another --out";
            Err(Failure::new(Exit::Usage, format!("{} is {reason}", path.display())))
        }
        Err(TryLockError::Error(error)) => Err(unwritable(path, &error)),
    }
}

/// Identification of this build: version, size and time of the executable file.
fn program() -> String {
    let file = std::env::current_exe().and_then(fs::metadata);
    let modified = file.as_ref().ok().and_then(|file| file.modified().ok());
    let size = file.as_ref().map_or(0, fs::Metadata::len);
    format!("oqtal {} {size} {modified:?}", env!("CARGO_PKG_VERSION"))
}

/// Hash of the arguments of this study, as text; the order of different flags does not matter.
fn own_arguments() -> String {
    format!("{:016x}", fnv1a(FNV_OFFSET, in_order(&command()).as_bytes()))
}

/// `command` with its flags, each with its values, in alphabetical order; a flag that is repeated keeps its order.
fn in_order(command: &str) -> String {
    let mut flags: Vec<&str> = command.split(" --").collect();
    flags[1..].sort_by_key(|flag| flag.split([' ', '=']).next());
    flags.join(" --")
}

/// Failure for a file or directory of a study that cannot be written.
pub(crate) fn unwritable(path: &Path, error: &io::Error) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}; give another --out", path.display()))
}

/// Whether the text of a journal has lines after its head.
fn has_results(text: &str) -> bool {
    text.lines().count() > 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_journal_holds_every_result_but_a_torn_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal");
        let journal = Journal::create(&path).unwrap();
        for (key, result) in (0..).zip(["a", "b", "c"]) {
            journal.keep(key, &result).unwrap();
        }
        for begin in [Journal::create, Journal::resume] {
            let failure = begin(&path).unwrap_err().to_string();
            assert!(failure.contains("a study that is running"), "{failure}");
        }
        assert!(Journal::has_results(&path).is_err());
        drop(journal);
        assert!(Journal::has_results(&path).unwrap());
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 3]).unwrap();
        let resumed = Journal::resume(&path).unwrap();
        let found = [0, 1, 2].map(|key| resumed.find::<String>(key));
        assert_eq!(found, [Some("a".to_owned()), Some("b".to_owned()), None]);
        assert_eq!(resumed.find::<u64>(0), None);
        assert_eq!((resumed.used(), resumed.resumed()), (2, 2));
        drop(resumed);
        let resumed = Journal::resume(&path).unwrap();
        assert_eq!((resumed.find::<u64>(0), resumed.used()), (None, 0), "of another type");
        assert_eq!((resumed.find::<String>(1), resumed.used()), (Some("b".to_owned()), 1));
        resumed.find::<String>(1);
        assert_eq!((resumed.used(), resumed.resumed()), (1, 2));
    }

    #[test]
    fn the_order_of_different_flags_does_not_matter() {
        let same = [
            "oqtal sweep a=1 --laws x --set b=1 --set c=2",
            "oqtal sweep a=1 --set b=1 --set c=2 --laws x",
        ];
        assert_eq!(in_order(same[0]), in_order(same[1]));
        assert_ne!(in_order(same[0]), in_order("oqtal sweep a=1 --set c=2 --set b=1 --laws x"));
        assert_eq!(in_order("oqtal reproduce"), "oqtal reproduce");
    }

    #[test]
    fn a_journal_of_another_build_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal");
        fs::write(&path, "oqtal 0.0.0 1 None\n").unwrap();
        let failure = Journal::resume(&path).unwrap_err();
        assert!(failure.to_string().contains("another build"), "{failure}");
        assert!(!Journal::has_these_arguments(&path), "the head has no hash");
        Journal::create(&path).unwrap();
        assert!(Journal::has_these_arguments(&path));
        assert!(Journal::resume(&directory.path().join("none")).is_err());
    }
}
