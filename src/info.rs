//! `oqtal info FILE`: contents of a recording.

use std::path::PathBuf;

use clap::Args;
use oqtal_observe::recording::{RecordingOverview, recording_path};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

use crate::recordings;

/// Arguments of `oqtal info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// The recording: a file, the directory of a flight, or `latest`
    #[arg(value_parser = recording_path)]
    file: PathBuf,
    /// Print the overview as JSON
    #[arg(long)]
    json: bool,
}

impl InfoArgs {
    /// Prints version, machine, configuration hash and topics of the recording.
    ///
    /// # Errors
    /// The file is not a recording (exit code 65).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let overview = RecordingOverview::of(&recordings::read(&self.file)?);
        let json = || serde_json::to_string_pretty(&overview).expect("an overview is plain JSON");
        print(&if self.json { json() } else { overview.to_text() })?;
        Ok(Exit::Ok)
    }
}
