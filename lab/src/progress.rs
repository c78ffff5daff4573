//! Progress of a study: on standard error, as bars in a terminal, else as a line every ten seconds; or passed to a callback. Results are
//! kept in a journal.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{interrupt_flag, say};
use oqtal_runtime::stop::StopFlag;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::journal::Journal;

/// Time between two lines.
const LINE_PERIOD: Span = Span::from_millis(10_000);

/// Receiver of the progress of a task: its name, the number of finished steps, and of all steps. Called in the threads of the study.
pub type ProgressWatch = dyn Fn(&str, u64, u64) + Send + Sync;

/// The progress of a command.
pub struct Progress {
    bars: MultiProgress,
    begun_at: Time,
    /// Number of periods after which the last line was printed \[-\].
    lines: AtomicU64,
    journal: Option<Journal>,
    /// Set by Ctrl-C.
    interrupted: StopFlag,
    /// Receiver in place of standard error.
    watch: Option<Box<ProgressWatch>>,
    /// Set from outside to end the study.
    is_cancelled: Arc<AtomicBool>,
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Progress")
            .field("is_watched", &self.watch.is_some())
            .finish_non_exhaustive()
    }
}

impl Default for Progress {
    fn default() -> Self {
        Self {
            bars: MultiProgress::new(),
            begun_at: Time::now(),
            lines: AtomicU64::new(0),
            journal: None,
            interrupted: StopFlag::default(),
            watch: None,
            is_cancelled: Arc::default(),
        }
    }
}

impl Progress {
    /// Progress that is passed to `watch`; nothing is printed. `is_cancelled` ends the study and its flights in progress.
    pub fn watched(watch: Box<ProgressWatch>, is_cancelled: Arc<AtomicBool>) -> Self {
        Self { watch: Some(watch), is_cancelled, ..Self::default() }
    }

    /// Progress that is kept in `journal`. Ctrl-C ends the study and its flights in progress; a second one ends the program.
    pub fn kept_in(journal: Journal) -> Self {
        if journal.resumed() > 0 {
            say(&format!(
                "resumed: the results in {} of the same flights with the same settings are used",
                journal.path().display()
            ));
        }
        Self { journal: Some(journal), interrupted: interrupt_flag(), ..Self::default() }
    }

    /// The result of `work` from the journal, where its `key` names it, or else the one that `make` returns, which is then kept.
    /// Without a journal no key is computed.
    ///
    /// # Errors
    /// The error of `make`, the journal cannot be written, or the study was interrupted (exit code 1).
    pub fn kept<W, T: Serialize + DeserializeOwned>(
        &self,
        work: W,
        key: impl FnOnce(&W) -> u64,
        make: impl FnOnce(W) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let make = |work| self.check().and_then(|()| make(work));
        let Some(journal) = &self.journal else { return make(work) };
        let key = key(&work);
        if let Some(result) = journal.find(key) {
            return Ok(result);
        }
        let result = make(work)?;
        journal.keep(key, &result)?;
        Ok(result)
    }

    /// Fails if the study was interrupted.
    ///
    /// # Errors
    /// The study was interrupted or cancelled (exit code 1).
    pub fn check(&self) -> Result<(), Failure> {
        if self.is_cancelled.load(Ordering::Relaxed) {
            return Err(Failure::new(Exit::Flight, "interrupted"));
        }
        match &self.journal {
            Some(journal) if self.interrupted.is_set() => {
                let reason = match journal.has_result() {
                    true => format!(
                        "interrupted; {} keeps the results so far: the same command with --resume continues",
                        journal.path().display()
                    ),
                    false => "interrupted before the first result that is kept: the same command begins again"
                        .to_owned(),
                };
                Err(Failure::new(Exit::Flight, reason))
            }
            _ => Ok(()),
        }
    }

    /// Executes `step` for each of `items` on all cores, as the task `name`; returns the results in the order of the items.
    ///
    /// # Errors
    /// The first error of `step`, or the study was interrupted (exit code 1).
    pub fn each<T: Sync, R: Send>(
        &self,
        name: &str,
        items: &[T],
        step: impl Fn(&T) -> Result<R, Failure> + Sync,
    ) -> Result<Vec<R>, Failure> {
        let bar = self.start(name, items.len());
        let one = |item: &T| {
            self.check()?;
            let result = step(item);
            bar.inc();
            result
        };
        items.par_iter().map(one).collect()
    }

    /// Begins a task of `steps` steps.
    pub fn start(&self, name: &str, steps: usize) -> Bar<'_> {
        let bar = match &self.watch {
            None => self.bars.add(ProgressBar::new(steps as u64)),
            Some(_) => ProgressBar::hidden(),
        };
        bar.set_length(steps as u64);
        let style = ProgressStyle::with_template("{msg:24} {bar:30.cyan/blue} {pos:>6}/{len}");
        bar.set_style(style.expect("the template is constant and valid"));
        bar.set_message(name.to_owned());
        Bar { bar, progress: self }
    }

    /// Prints a line about `bar` if none was printed in this period.
    fn print_line(&self, bar: &ProgressBar) {
        let elapsed = Time::now().since(self.begun_at);
        let period = (elapsed.nanos() / LINE_PERIOD.nanos()).unsigned_abs();
        if self.lines.fetch_max(period, Ordering::Relaxed) < period {
            let (done, all) = (bar.position(), bar.length().unwrap_or(0));
            say(&format!("{}: {done} of {all}, {:.0} s", bar.message(), elapsed.seconds()));
        }
    }
}

/// The progress of one task; its bar is removed when it is dropped.
#[derive(Debug)]
pub struct Bar<'a> {
    bar: ProgressBar,
    progress: &'a Progress,
}

impl Bar<'_> {
    /// Advances by one step.
    pub fn inc(&self) {
        self.add(1);
    }

    /// Advances by `steps`.
    pub fn add(&self, steps: usize) {
        self.bar.inc(steps as u64);
        if let Some(watch) = &self.progress.watch {
            watch(&self.bar.message(), self.bar.position(), self.bar.length().unwrap_or(0));
        } else if self.progress.bars.is_hidden() {
            self.progress.print_line(&self.bar);
        }
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interrupted_study_names_its_journal_only_if_it_keeps_a_result() {
        let directory = tempfile::tempdir().unwrap();
        let journal = Journal::create(&directory.path().join("journal")).unwrap();
        let progress = Progress { journal: Some(journal), ..Progress::default() };
        progress.interrupted.set();
        let reason = || progress.check().unwrap_err().to_string();
        assert!(!reason().contains("--resume"), "{}", reason());
        progress.journal.as_ref().unwrap().keep(1, &7).unwrap();
        assert!(reason().contains("--resume"), "{}", reason());
    }
}
