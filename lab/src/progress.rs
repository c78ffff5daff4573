//! Progress bars of a study on standard error; hidden if standard error is not a terminal.

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

/// The progress bars of a command.
#[derive(Debug, Default)]
pub struct Progress {
    bars: MultiProgress,
}

impl Progress {
    /// Adds a bar for a task of `steps` steps.
    pub fn start(&self, name: &str, steps: usize) -> Bar {
        let bar = self.bars.add(ProgressBar::new(steps as u64));
        let style = ProgressStyle::with_template("{msg:24} {bar:30.cyan/blue} {pos:>6}/{len}");
        bar.set_style(style.expect("the template is constant and valid"));
        bar.set_message(name.to_owned());
        Bar(bar)
    }
}

/// The progress bar of one task, removed when dropped.
#[derive(Debug)]
pub struct Bar(ProgressBar);

impl Bar {
    /// Advances by one step.
    pub fn inc(&self) {
        self.0.inc(1);
    }

    /// Advances by `steps`.
    pub fn add(&self, steps: usize) {
        self.0.inc(steps as u64);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
