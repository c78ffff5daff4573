//! Motion capture as a program of its own.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{ProcessCommand, execute};
use oqtal_runtime::program;

/// The motion-capture process of oqtal: emulated cameras, or a recording
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: ProcessCommand,
}

fn main() -> ExitCode {
    program::run(|cli: Cli| {
        execute(Role::Mocap, &cli.command, oqtal_mocap_emu::run, oqtal_mocap_emu::check)
    })
}
