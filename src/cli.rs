//! The command line.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use oqtal_bus::process::{Exit, Failure, Job, ProcessCommand, execute};
use oqtal_bus::topic::Party;

use crate::check::CheckArgs;
use crate::ctl::CtlArgs;
use crate::doctor::DoctorArgs;
use crate::fly::FlyArgs;
use crate::latency::{LatencyArgs, Part};

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
    /// Speak to a running daemon
    Ctl(CtlArgs),
    /// Where the time goes, beside what the machine gives bare
    Latency(LatencyArgs),
    /// Whether this machine is fit to fly, and what would make it fitter
    Doctor(DoctorArgs),
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
    /// A stand-in that `latency` starts
    #[command(subcommand, hide = true)]
    LatencyPart(Part),
}

impl Cli {
    /// Does what the command line says.
    #[must_use]
    pub fn execute(self) -> ExitCode {
        let process = |party, command: &ProcessCommand, job: Job| execute(party, command, job);
        let result = match self.command {
            None => self.fly.execute(),
            Some(Command::Fly(args)) => args.execute(),
            Some(Command::Ctl(args)) => args.execute(),
            Some(Command::Latency(args)) => args.execute(),
            Some(Command::Doctor(args)) => args.execute(),
            Some(Command::Check(args)) => args.execute(),
            Some(Command::LatencyPart(part)) => return part.execute(),
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
