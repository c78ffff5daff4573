//! Motion capture as a standalone program.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_runtime::program;

/// The motion-capture process of oqtal: emulated cameras, or a recording
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: oqtal_mocap_emu::MocapCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| cli.command.execute())
}
