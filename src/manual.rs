//! `oqtal completions SHELL` and `oqtal man DIR`: shell completions and manual pages from the definitions of the commands. The
//! installer runs both, so that they match the installed program.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_complete::Shell;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

/// Arguments of `oqtal completions`.
#[derive(Args, Debug)]
pub struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

impl CompletionsArgs {
    /// Prints the completions of `command`.
    ///
    /// # Errors
    /// Standard output cannot be written.
    pub fn execute(&self, mut command: Command) -> Result<Exit, Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command, "oqtal", &mut script);
        print(String::from_utf8_lossy(&script).trim_end())?;
        Ok(Exit::Ok)
    }
}

/// Arguments of `oqtal man`.
#[derive(Args, Debug)]
pub struct ManArgs {
    /// Directory of the pages
    directory: PathBuf,
}

impl ManArgs {
    /// Writes one page for `command` and one for each of its subcommands.
    ///
    /// # Errors
    /// The directory cannot be created or written (exit code 71).
    pub fn execute(&self, command: Command) -> Result<Exit, Failure> {
        let failed = |error: std::io::Error| {
            Failure::new(Exit::System, format!("{}: {error}", self.directory.display()))
        };
        std::fs::create_dir_all(&self.directory).map_err(failed)?;
        write_pages(command, &self.directory).map_err(failed)?;
        Ok(Exit::Ok)
    }
}

fn write_pages(command: Command, directory: &Path) -> std::io::Result<()> {
    clap_mangen::generate_to(command.disable_help_subcommand(true), directory)
}

#[cfg(test)]
mod tests;
