//! The plant as a program of its own.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_bus::process::{ProcessCommand, execute};
use oqtal_bus::program;
use oqtal_bus::topic::Party;

/// The plant process of oqtal: a simulated vehicle and its radio
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: ProcessCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| {
        execute(Party::Plant, &cli.command, oqtal_plant_sim::run, oqtal_plant_sim::check)
    })
}
