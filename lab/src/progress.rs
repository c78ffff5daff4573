//! Progress of a study on standard error: bars in a terminal, else a line every ten seconds.

use std::sync::atomic::{AtomicU64, Ordering};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::program::say;

/// Time between two lines.
const LINE_PERIOD: Span = Span::from_millis(10_000);

/// The progress of a command.
#[derive(Debug)]
pub struct Progress {
    bars: MultiProgress,
    begun_at: Time,
    /// Number of periods after which the last line was printed \[-\].
    lines: AtomicU64,
}

impl Default for Progress {
    fn default() -> Self {
        Self { bars: MultiProgress::new(), begun_at: Time::now(), lines: AtomicU64::new(0) }
    }
}

impl Progress {
    /// Begins a task of `steps` steps.
    pub fn start(&self, name: &str, steps: usize) -> Bar<'_> {
        let bar = self.bars.add(ProgressBar::new(steps as u64));
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
        if self.progress.bars.is_hidden() {
            self.progress.print_line(&self.bar);
        }
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
