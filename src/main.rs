//! The `oqtal` program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use oqtal::cli::Cli;

fn main() -> ExitCode {
    oqtal_runtime::program::run(Cli::execute)
}
