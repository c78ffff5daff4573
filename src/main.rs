//! The `oqtal` program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal::cli::Cli;

fn main() -> ExitCode {
    match Cli::try_parse() {
        Ok(cli) => cli.execute(),
        Err(error) => oqtal::cli::explain(&error),
    }
}
