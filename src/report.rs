//! `oqtal report FILE`: page of a flight from its recording.

use std::path::{Path, PathBuf};

use clap::Args;
use oqtal_observe::recording::{RECORDING, SUMMARY, recording_path};
use oqtal_observe::summary::Summary;
use oqtal_observe::{report, table};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};

use crate::fly::REPORT;
use crate::provenance::PROVENANCE;
use crate::recordings;

/// Arguments of `oqtal report`.
#[derive(Args, Debug)]
pub struct ReportArgs {
    /// The recording: a file, one of its flights as FILE#NUMBER, the directory of a flight, or `latest`
    #[arg(value_parser = recording_path)]
    file: PathBuf,
    /// The page, or its directory; only a page of oqtal is replaced [default: report.html of the flight, or FILE with .html in place
    /// of .mcap]
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
    /// The file is not a recording (exit code 65), of another version (76) or of several flights (64), or the page cannot be written.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let path = recordings::page_path(&self.page(), REPORT)?;
        self.check_directory(&path)?;
        let flight = recordings::read_flight(&self.file)?;
        recordings::require_one(&self.file, &flight)?;
        let summary = Summary::of(&flight);
        print(&if self.json { summary.to_json(PROVENANCE) } else { table::closing(&summary) })?;
        recordings::write(&path, report::html(&flight, &summary))?;
        if !self.json {
            print(&format!("report: {}", path.display()))?;
            summary.shortfall.iter().for_each(|shortfall| say(&format!("oqtal: {shortfall}")));
        }
        Ok(Exit::Ok)
    }

    /// Refuses the directory of another flight, whose page it would replace.
    fn check_directory(&self, page: &Path) -> Result<(), Failure> {
        let own = self.file.with_file_name(SUMMARY);
        let other = page.with_file_name(SUMMARY);
        if !page.exists() || !other.exists() || other.canonicalize().ok() == own.canonicalize().ok()
        {
            return Ok(());
        }
        let message = format!(
            "{} is of another flight, so it is not replaced; give another --out",
            page.display()
        );
        Err(Failure::new(Exit::Usage, message))
    }

    /// The page of --out; by default the one that `oqtal fly` writes as well.
    fn page(&self) -> PathBuf {
        let is_of_flight = self.file.file_name().is_some_and(|name| name == RECORDING);
        let default = || match is_of_flight {
            true => self.file.with_file_name(REPORT),
            false => format!("{}.html", recordings::stem(&self.file).display()).into(),
        };
        self.out.clone().unwrap_or_else(default)
    }
}
