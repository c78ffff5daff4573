//! The plant as a program of its own.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_bus::process::{ProcessCommand, execute};
use oqtal_bus::topic::Party;

/// The plant process of oqtal: a simulated vehicle and its radio
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: ProcessCommand,
}

fn main() -> ExitCode {
    execute(Party::Plant, &Cli::parse().command, oqtal_plant_sim::run)
}
