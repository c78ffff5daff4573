//! The plant as a standalone program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_runtime::program;

/// The plant process of oqtal: a simulated vehicle and its radio
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: oqtal_plant_sim::PlantCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| cli.command.execute())
}
