//! `oqtal check FILE`: the effective configuration.

use std::path::PathBuf;

use clap::Args;
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure, describe};
use oqtal_runtime::program::print;

/// What to check.
#[derive(Args, Debug)]
pub struct CheckArgs {
    /// Configuration file (TOML); the built-in values without
    file: Option<PathBuf>,
}

impl CheckArgs {
    /// Prints the configuration that a process would run with.
    ///
    /// # Errors
    /// The file has an error: exit code 78, with its line. A file that it names is bad: exit code 65.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.file.as_deref(), &[])?;
        oqtal_bridge::check_options(&config).map_err(|error| config.locate(&error))?;
        oqtal_daemon::check(&config)?;
        oqtal_plant_sim::check(&config)?;
        oqtal_mocap_emu::check(&config)?;
        print(&describe(&config))?;
        Ok(Exit::Ok)
    }
}
