//! The controller as a standalone program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{ProcessCommand, execute};
use oqtal_runtime::program;

/// The controller process of oqtal: from poses to commands
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: ProcessCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| {
        execute(Role::Daemon, &cli.command, oqtal_daemon::run, oqtal_daemon::check)
    })
}
