//! The command line.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure, ProcessCommand, execute};
use oqtal_runtime::program::conclude;

use crate::check::CheckArgs;
use crate::ctl::CtlArgs;
use crate::doctor::DoctorArgs;
use crate::fly::{FlyArgs, Series};
use crate::latency::{LatencyArgs, Part};
use oqtal_lab::campaign::CampaignArgs;
use oqtal_lab::reproduce::ReproduceArgs;
use oqtal_lab::tune::TuneArgs;

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
    PlantSim(oqtal_plant_sim::PlantCommand),
    /// The motion-capture process: emulated cameras, or a recording
    #[command(subcommand)]
    MocapEmu(ProcessCommand),
    /// The bridge process: a real vehicle over a radio
    #[command(subcommand)]
    Bridge(oqtal_bridge::BridgeCommand),
    /// A stand-in that `latency` starts
    #[command(subcommand, hide = true)]
    LatencyPart(Part),
}

impl Cli {
    /// Does what the command line says.
    #[must_use]
    pub fn execute(self) -> ExitCode {
        let result = match self.command {
            None => self.fly.execute(),
            Some(Command::Fly(args)) => args.execute(),
            Some(Command::Campaign(args)) => {
                args.execute(&|directory| Ok(Box::new(Series::begin(directory)?)))
            }
            Some(Command::Reproduce(args)) => args.execute(),
            Some(Command::Tune(args)) => args.execute(),
            Some(Command::Ctl(args)) => args.execute(),
            Some(Command::Latency(args)) => args.execute(),
            Some(Command::Doctor(args)) => args.execute(),
            Some(Command::Check(args)) => args.execute(),
            Some(Command::LatencyPart(part)) => return part.execute(),
            Some(Command::Daemon(command)) => {
                return execute(Role::Daemon, &command, oqtal_daemon::run, oqtal_daemon::check);
            }
            Some(Command::PlantSim(command)) => return command.execute(),
            Some(Command::Bridge(command)) => return command.execute(),
            Some(Command::MocapEmu(command)) => {
                use oqtal_mocap_emu::{check, run};
                return execute(Role::Mocap, &command, run, check);
            }
        };
        finish(result)
    }
}

fn finish(result: Result<Exit, Failure>) -> ExitCode {
    match result {
        Ok(exit) => exit.into(),
        Err(failure) => conclude("oqtal", &failure),
    }
}
