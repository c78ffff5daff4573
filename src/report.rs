//! `oqtal report FILE`: page of a flight from its recording.

use std::path::PathBuf;

use clap::Args;
use oqtal_observe::recording::recording_path;
use oqtal_observe::summary::Summary;
use oqtal_observe::{report, table};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

use crate::provenance::PROVENANCE;
use crate::recordings;

/// Arguments of `oqtal report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// The recording: a file, the directory of a flight, or `latest`
    #[arg(value_parser = recording_path)]
    file: PathBuf,
    /// The page [default: FILE with .html in place of .mcap]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of a table
    #[arg(long)]
    json: bool,
}

impl ReportArgs {
    /// Prints the figures of the flight and writes the page, like `oqtal fly`.
    ///
    /// # Errors
    /// The file is not a recording (exit code 65) or of another version (76), or the page cannot be written.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let flight = recordings::read_flight(&self.file)?;
        let summary = Summary::of(&flight);
        print(&if self.json { summary.to_json(PROVENANCE) } else { table::closing(&summary) })?;
        let path = self.out.clone().unwrap_or_else(|| self.file.with_extension("html"));
        recordings::write(&path, report::html(&flight, &summary))?;
        if !self.json {
            print(&format!("report: {}", path.display()))?;
        }
        Ok(Exit::Ok)
    }
}
