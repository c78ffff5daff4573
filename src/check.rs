//! `oqtal check FILE`: the effective configuration.

use std::path::PathBuf;

use clap::Args;
use oqtal_bus::config::Config;
use oqtal_bus::process::{Exit, Failure};

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
    /// The file has an error: exit code 78, with its line.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.file.as_deref(), &[])?;
        oqtal_daemon::Pilot::new(&config).map_err(|reason| Failure::new(Exit::Config, reason))?;
        print!("{}", config.to_toml());
        Ok(Exit::Ok)
    }
}
