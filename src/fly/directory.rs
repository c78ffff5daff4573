//! Output directory of a flight.

use std::fs;
use std::path::{Path, PathBuf};

use oqtal_bus::paths::quoted;
use oqtal_bus::topic::Role;
use oqtal_config::Config;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};

use oqtal_lab::output::STUDY_CONFIG_BEGINS;
use oqtal_observe::flight::Flight;
use oqtal_observe::recording::{RECORDING, SUMMARY};
use oqtal_observe::summary::Summary;
use oqtal_observe::{csv, report};

use crate::provenance::PROVENANCE;

/// File with the effective configuration.
const CONFIG: &str = "config.toml";
/// File with the figures of every tick.
const TELEMETRY: &str = "telemetry.csv";
/// File with the report.
pub const REPORT: &str = "report.html";
/// Files of a flight that was flown.
const RESULTS: [&str; 4] = [RECORDING, SUMMARY, REPORT, TELEMETRY];
/// Folder in the directory with copies of the files that the flight reads.
const INPUTS: &str = "inputs";

/// Output directory of one flight: configuration, input files, logs, summary, report, telemetry.
#[derive(Debug)]
pub struct FlightDirectory {
    directory: PathBuf,
    /// Whether it was made for this flight, with a name of its own.
    is_new: bool,
}

impl FlightDirectory {
    /// Creates the directory, by default `flights/INSTANCE-N`, and writes the effective configuration and its input files into
    /// it, so that the flight can be repeated from any location of the directory.
    ///
    /// # Errors
    /// The directory already contains a flight, or cannot be created or written.
    pub fn create(given: Option<&Path>, config: &Config) -> Result<Self, Failure> {
        let has_results = |directory: &&Path| {
            let is_of_study = fs::read_to_string(directory.join(CONFIG))
                .is_ok_and(|text| text.starts_with(STUDY_CONFIG_BEGINS));
            is_of_study || RESULTS.iter().any(|name| directory.join(name).exists())
        };
        if let Some(directory) = given.filter(has_results) {
            let directory = directory.display();
            let reason = format!(
                "{directory} holds a flight or other results already; give another --out, or --force"
            );
            return Err(Failure::new(Exit::Usage, reason));
        }
        Self::create_or_replace(given, config)
    }

    /// Like [`FlightDirectory::create`]; replaces the files of a flight that the directory contains. Those that this flight may not
    /// write, as recording and logs, are removed.
    ///
    /// # Errors
    /// The directory cannot be created or written.
    pub fn create_or_replace(given: Option<&Path>, config: &Config) -> Result<Self, Failure> {
        let directory = match given {
            Some(directory) => {
                fs::create_dir_all(directory).map_err(|e| failed(directory, &e))?;
                // The owner of the directory could replace the configuration before the processes read it.
                let real = directory.canonicalize();
                let checked = real.and_then(|real| files::check_own_directory(&real));
                checked.map_err(|e| failed(directory, &e))?;
                directory.to_path_buf()
            }
            None => next_free(&config.instance.name)?,
        };
        let created = Self { directory, is_new: given.is_none() };
        // The files that the flight reads are copied first: one of them may be in the directory.
        let config = config.clone().with_files_at(|file| created.copy(file))?;
        if created.config().exists() {
            created.remove_results()?;
        }
        created.save(CONFIG, &config.to_toml())?;
        Ok(created)
    }

    /// Copies `file` into the directory; returns its path relative to the directory.
    fn copy(&self, file: &Path) -> Result<PathBuf, Failure> {
        let inputs = self.directory.join(INPUTS);
        let copied = Path::new(INPUTS).join(file.file_name().unwrap_or_default());
        let to = self.directory.join(&copied);
        // The configuration of a flight, flown again into its own directory.
        let is_itself = to.exists() && to.canonicalize().ok() == file.canonicalize().ok();
        fs::create_dir_all(&inputs).map_err(|e| failed(&inputs, &e))?;
        files::check_own_directory(&inputs).map_err(|e| failed(&inputs, &e))?;
        if !is_itself {
            let mut from = fs::File::open(file).map_err(|e| failed(file, &e))?;
            let copy = files::create(&to).and_then(|mut to| std::io::copy(&mut from, &mut to));
            copy.map_err(|e| failed(&to, &e))?;
        }
        Ok(copied)
    }

    /// Removes what an older flight wrote: results and logs.
    fn remove_results(&self) -> Result<(), Failure> {
        let results = RESULTS.map(str::to_owned).into_iter();
        let processes = Role::PROCESSES.map(Role::name).into_iter().chain(["chain"]);
        let logs = processes.map(|process| format!("{process}.log"));
        for path in results.chain(logs).map(|name| self.directory.join(name)) {
            files::remove(&path).map_err(|error| failed(&path, &error))?;
        }
        Ok(())
    }

    /// Removes the directory of a flight that was refused, if it was made for it.
    pub fn discard(&self) {
        if self.is_new {
            // Ignored: the refusal is reported.
            let _ = fs::remove_dir_all(&self.directory);
        }
    }

    /// The path of the directory.
    pub fn path(&self) -> &Path {
        &self.directory
    }

    /// Path of the effective configuration, for the processes.
    pub fn config(&self) -> PathBuf {
        self.directory.join(CONFIG)
    }

    /// Path of the recording.
    pub fn recording(&self) -> PathBuf {
        self.directory.join(RECORDING)
    }

    /// Writes summary, report and telemetry of the flight, whose recording is at `recorded`.
    ///
    /// # Errors
    /// A file cannot be written; the message then names the command that makes the report from the recording.
    pub fn write(
        &self,
        flight: &Flight,
        summary: &Summary,
        recorded: Option<&Path>,
    ) -> Result<(), Failure> {
        let written = self.write_results(flight, summary);
        written.map_err(|failure| match recorded.filter(|path| path.exists()) {
            Some(recorded) => {
                let is_here = recorded == self.recording();
                let file = if is_here { self.path() } else { recorded };
                let remedy = format!(
                    "`oqtal report {} --out FILE` makes the report elsewhere from what was recorded",
                    quoted(&file.display().to_string())
                );
                Failure::new(failure.exit, format!("{}; {remedy}", failure.message))
            }
            None => failure,
        })
    }

    fn write_results(&self, flight: &Flight, summary: &Summary) -> Result<(), Failure> {
        self.save(SUMMARY, &summary.to_json(PROVENANCE))?;
        self.save(REPORT, &report::html(flight, summary))?;
        let path = self.directory.join(TELEMETRY);
        let file = files::create(&path).map_err(|e| failed(&path, &e))?;
        let written = csv::write(flight, std::io::BufWriter::new(file));
        written.map_err(|e| {
            drop(files::remove(&path));
            failed(&path, &e)
        })
    }

    /// Path of the report.
    pub fn report(&self) -> PathBuf {
        self.directory.join(REPORT)
    }

    fn save(&self, name: &str, text: &str) -> Result<(), Failure> {
        let path = self.directory.join(name);
        files::write(&path, text).map_err(|e| failed(&path, &e))
    }
}

/// Creates the first `flights/INSTANCE-N` that does not exist.
fn next_free(instance: &str) -> Result<PathBuf, Failure> {
    let flights = Path::new("flights");
    fs::create_dir_all(flights).map_err(|e| failed(flights, &e))?;
    files::check_own_directory(flights)
        .and_then(|()| files::create_numbered(flights, instance))
        .map_err(|e| failed(flights, &e))
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(
        Exit::System,
        format!("{}: {error}; give another directory with --out", path.display()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replaced_flight_leaves_no_result_and_no_log_behind() {
        let directory = tempfile::tempdir().unwrap();
        let out = Some(directory.path());
        let config = Config::default();
        FlightDirectory::create(out, &config).unwrap();
        // A flight that did not begin leaves the directory free.
        FlightDirectory::create(out, &config).unwrap();
        for name in [RECORDING, SUMMARY, "daemon.log", "notes.txt"] {
            fs::write(directory.path().join(name), "old").unwrap();
        }
        assert!(FlightDirectory::create(out, &config).is_err());
        FlightDirectory::create_or_replace(out, &config).unwrap();
        let entries = fs::read_dir(directory.path()).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, [CONFIG, "notes.txt"]);
        let of_study = oqtal_lab::output::config_file_text(&config);
        fs::write(directory.path().join(CONFIG), of_study).unwrap();
        assert!(FlightDirectory::create(out, &config).is_err());
    }
}
