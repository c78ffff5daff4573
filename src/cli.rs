//! The command line.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use oqtal_bus::process::{Exit, Failure, Job, ProcessCommand, execute};
use oqtal_bus::topic::Party;

use crate::campaign::CampaignArgs;
use crate::check::CheckArgs;
use crate::ctl::CtlArgs;
use crate::fly::FlyArgs;
use crate::reproduce::ReproduceArgs;
use crate::tune::TuneArgs;

/// Real-time quaternion control for indoor flight laboratories
///
/// Without a command: flies the square with `oqtal` through three processes, in real time.
#[derive(Parser, Debug)]
#[command(name = "oqtal", version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fly: FlyArgs,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Fly a trajectory: start the processes, fly, land, print errors and latencies, write a report
    Fly(Box<FlyArgs>),
    /// Fly every attitude law many times, and compare
    Campaign(CampaignArgs),
    /// Repeat the paper's experiments: its tables and figures, as printed and ours
    Reproduce(ReproduceArgs),
    /// Tune gains on simulated flights
    Tune(TuneArgs),
    /// Speak to a running daemon
    Ctl(CtlArgs),
    /// Print the effective configuration of a file
    Check(CheckArgs),
    /// The controller process
    #[command(subcommand)]
    Daemon(ProcessCommand),
    /// The plant process: a simulated vehicle
    #[command(subcommand)]
    PlantSim(ProcessCommand),
    /// The motion-capture process: emulated cameras, or a recording
    #[command(subcommand)]
    MocapEmu(ProcessCommand),
}

impl Cli {
    /// Does what the command line says.
    #[must_use]
    pub fn execute(self) -> ExitCode {
        let process = |party, command: &ProcessCommand, job: Job| execute(party, command, job);
        let result = match self.command {
            None => self.fly.execute(),
            Some(Command::Fly(args)) => args.execute(),
            Some(Command::Campaign(args)) => args.execute(),
            Some(Command::Reproduce(args)) => args.execute(),
            Some(Command::Tune(args)) => args.execute(),
            Some(Command::Ctl(args)) => args.execute(),
            Some(Command::Check(args)) => args.execute(),
            Some(Command::Daemon(command)) => {
                return process(Party::Daemon, &command, oqtal_daemon::run);
            }
            Some(Command::PlantSim(command)) => {
                return process(Party::Plant, &command, oqtal_plant_sim::run);
            }
            Some(Command::MocapEmu(command)) => {
                return process(Party::Mocap, &command, oqtal_mocap_emu::run);
            }
        };
        finish(result)
    }
}

fn finish(result: Result<Exit, Failure>) -> ExitCode {
    match result {
        Ok(exit) => exit.into(),
        Err(failure) => {
            eprintln!("oqtal: {failure}");
            failure.exit.into()
        }
    }
}

/// Prints help, version or what is wrong with the command line, with the exit code that goes with it.
#[must_use]
pub fn explain(error: &clap::Error) -> ExitCode {
    // Nothing is left to tell if standard output and error are closed.
    let _ = error.print();
    if error.use_stderr() { Exit::Usage.into() } else { Exit::Ok.into() }
}
