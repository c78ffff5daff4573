//! The receiver of a real camera system as a standalone program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_runtime::program;

/// The receiver process of oqtal: poses of a real camera system, in place of the emulated one
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: oqtal_receiver::ReceiverCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| cli.command.execute())
}
