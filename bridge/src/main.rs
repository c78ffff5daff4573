//! The bridge to a real vehicle as a standalone program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_runtime::program;

/// The bridge process of oqtal: a real vehicle over a radio, in place of the simulated one
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: oqtal_bridge::BridgeCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| cli.command.execute())
}
