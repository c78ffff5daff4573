//! `oqtal compare FILE FILE…`: comparison of recorded flights.

use std::path::PathBuf;

use clap::Args;
use oqtal_lab::output::next_free;
use oqtal_observe::compare::{Comparison, MOST_FLIGHTS};
use oqtal_observe::recording::recording_path;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};

use crate::recordings;

/// Name of the page in a directory.
const PAGE: &str = "compare.html";

/// Arguments of `oqtal compare`.
#[derive(Args, Debug)]
pub struct CompareArgs {
    /// The recordings, or flights of them as FILE#NUMBER
    #[arg(num_args = 2.., required = true, value_name = "FILE", value_parser = recording_path)]
    files: Vec<PathBuf>,
    /// The page with overlaid plots, or its directory; only a page of oqtal is replaced [default: compare.html in
    /// results/compare-N]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl CompareArgs {
    /// Prints tables of errors, hops and settings that differ, and writes the page.
    ///
    /// # Errors
    /// A file is not a recording (exit code 65) or of another version (76), there are too many (64), or the page cannot be written.
    pub fn execute(&self) -> Result<Exit, Failure> {
        if self.files.len() > MOST_FLIGHTS {
            let message = format!(
                "at most {MOST_FLIGHTS} recordings can be compared; `oqtal info DIRECTORY` lists all flights"
            );
            return Err(Failure::new(Exit::Usage, message));
        }
        let out = self.out.as_ref().map(|out| recordings::page_path(out, PAGE)).transpose()?;
        let mut flights = Vec::new();
        for path in &self.files {
            let flown = recordings::read_flight(path)?;
            recordings::require_one(path, &flown)?;
            if let Some(reason) = flown.reservation() {
                say(&format!("oqtal: warning: {}: {reason}", path.display()));
            }
            flights.push((path.display().to_string(), flown));
        }
        let comparison = Comparison::new(flights);
        print(&comparison.to_text())?;
        let page = match out {
            Some(page) => page,
            None => next_free("compare")?.join(PAGE),
        };
        recordings::write(&page, comparison.to_html())?;
        print(&format!("plots: {}", page.display()))?;
        Ok(Exit::Ok)
    }
}
