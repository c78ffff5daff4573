//! `oqtal check FILE`: the effective configuration.

use std::path::PathBuf;

use clap::Args;
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure, check_instance, describe};
use oqtal_runtime::program::{print, say};

/// Arguments of `oqtal check`.
#[derive(Args, Debug)]
pub struct CheckArgs {
    /// Configuration file (TOML) [default: the built-in values]
    file: Option<PathBuf>,
}

impl CheckArgs {
    /// Checks the configuration as every process would, and prints it.
    ///
    /// # Errors
    /// The file has an error (exit code 78, with its line), or a file that it names is bad (65).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.file.as_deref(), &[])?;
        check_instance(&config)?;
        oqtal_bridge::check_options(&config).map_err(|error| config.locate(&error))?;
        oqtal_daemon::check(&config)?;
        oqtal_plant_sim::check(&config)?;
        oqtal_mocap_emu::check(&config)?;
        let told = oqtal_daemon::warnings(&config, &oqtal_daemon::trajectory(&config)?);
        told.iter().for_each(|told| say(&format!("oqtal: warning: {told}")));
        print(&describe(&config))?;
        Ok(Exit::Ok)
    }
}
