//! `oqtal export FILE`: a recording as files for other tools.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use oqtal_observe::recording::{
    ColumnExport, CsvExport, RecordingFile, SUMMARY, Tables, TumExport, flight, play,
    recording_path,
};
use oqtal_observe::{csv, mat};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

use crate::recordings::{self, failure};

/// Arguments of `oqtal export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// The recording: a file, one of its flights as FILE#NUMBER, the directory of a flight, or `latest`
    #[arg(value_parser = recording_path)]
    file: PathBuf,
    /// Format of the files
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// Topics, separated by commas [default: all; for csv and mat the table of ticks that `oqtal fly` writes as well]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    topics: Vec<String>,
    /// Directory of the files [default: FILE without .mcap, and -csv, -mat or -tum]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// A format of files.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ExportFormat {
    /// A row for each message, units in the column names
    Csv,
    /// MATLAB, Octave, SciPy: a variable for each column of the CSV
    Mat,
    /// Trajectories: lines `time x y z qx qy qz qw`
    Tum,
}

/// Contents of files by the names of their tables.
type Files = BTreeMap<String, Vec<u8>>;

/// Name of the table of ticks.
const TICKS: &str = "ticks";
/// The same table in the directory of a flight.
const FLIGHTS_TICKS: &str = "telemetry.csv";

impl ExportFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Mat => "mat",
            Self::Tum => "tum",
        }
    }
}

/// Refuses a directory whose file `telemetry.csv`, a topic's name too, is the table of ticks of a flight.
fn check_directory(directory: &Path, names: &[String]) -> Result<(), Failure> {
    let is_of_flight = directory.join(SUMMARY).exists() && directory.join(FLIGHTS_TICKS).exists();
    if !is_of_flight || !names.iter().any(|name| name == FLIGHTS_TICKS) {
        return Ok(());
    }
    let message = format!(
        "{}/{FLIGHTS_TICKS} is of a flight, so it is not replaced; give another --out",
        directory.display()
    );
    Err(Failure::new(Exit::Usage, message))
}

impl ExportArgs {
    /// Writes a file for each topic and prints their paths.
    ///
    /// # Errors
    /// The file is not a recording (exit code 65) or of another version (76), a topic is unknown (64), or a file cannot be written.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let file = recordings::read(&self.file)?;
        let extension = self.format.extension();
        let mut tables = self.tables(&file)?;
        if !self.topics.is_empty() {
            self.check_topics(&tables)?;
            tables.retain(|name, _| self.topics.contains(name));
        }
        let directory = self.directory();
        std::fs::create_dir_all(&directory).map_err(|error| {
            Failure::new(Exit::System, format!("{}: {error}", directory.display()))
        })?;
        let file_of = |name: &String| format!("{}.{extension}", name.replace('/', "-"));
        check_directory(&directory, &tables.keys().map(file_of).collect::<Vec<_>>())?;
        for (name, table) in &tables {
            let path = directory.join(file_of(name));
            recordings::write(&path, table)?;
            print(&path.display().to_string())?;
        }
        Ok(Exit::Ok)
    }

    /// The files of the format by the names of their tables.
    fn tables(&self, file: &RecordingFile) -> Result<Files, Failure> {
        let of_text =
            |tables: Tables| tables.into_iter().map(|(n, t)| (n, t.into_bytes())).collect();
        match self.format {
            ExportFormat::Tum => {
                let mut export = TumExport::default();
                play(file, &mut export).map_err(failure)?;
                Ok(of_text(export.tables))
            }
            ExportFormat::Mat => {
                let mut export = ColumnExport::default();
                play(file, &mut export).map_err(failure)?;
                let ticks = mat::file(csv::columns(&flight(file).map_err(failure)?));
                let tables =
                    export.tables.into_iter().map(|(name, table)| (name, mat::file(table)));
                Ok(tables.chain([(TICKS.to_owned(), ticks)]).collect())
            }
            ExportFormat::Csv => {
                let mut export = CsvExport::default();
                play(file, &mut export).map_err(failure)?;
                let mut ticks = Vec::new();
                csv::write(&flight(file).map_err(failure)?, &mut ticks)
                    .map_err(|error| Failure::new(Exit::Internal, error.to_string()))?;
                let mut files = of_text(export.tables);
                files.insert(TICKS.to_owned(), ticks);
                Ok(files)
            }
        }
    }

    fn check_topics(&self, tables: &Files) -> Result<(), Failure> {
        let Some(unknown) = self.topics.iter().find(|name| !tables.contains_key(*name)) else {
            return Ok(());
        };
        let known: Vec<&str> = tables.keys().map(String::as_str).collect();
        let message =
            format!("`{unknown}` has no table in this format; there are {}", known.join(", "));
        Err(Failure::new(Exit::Usage, message))
    }

    fn directory(&self) -> PathBuf {
        let named = || {
            let stem = recordings::stem(&self.file);
            PathBuf::from(format!("{}-{}", stem.display(), self.format.extension()))
        };
        self.out.clone().unwrap_or_else(named)
    }
}
