//! The command line.

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{ProcessCommand, execute};
use oqtal_runtime::program::{command_word, fail};

use crate::chain::ChainCommand;
use crate::check::CheckArgs;
use crate::compare::CompareArgs;
use crate::ctl::CtlArgs;
use crate::doctor::DoctorArgs;
use crate::export::ExportArgs;
use crate::fly::{BusFlightSeries, FlyArgs};
use crate::gateway::GatewayCommand;
use crate::info::InfoArgs;
use crate::latency::{LatencyArgs, PartArgs};
use crate::live_tuning;
use crate::manual::{CompletionsArgs, ManArgs};
use crate::record::RecordArgs;
use crate::recordings;
use crate::replay::ReplayArgs;
use crate::report::ReportArgs;
use crate::view::ViewArgs;
use oqtal_lab::cameras::CamerasCommand;
use oqtal_lab::campaign::CampaignArgs;
use oqtal_lab::identify::command::IdentifyArgs;
use oqtal_lab::reproduce::ReproduceArgs;
use oqtal_lab::robustness::RobustnessArgs;
use oqtal_lab::sweep::SweepArgs;
use oqtal_lab::tune::TuneArgs;
use oqtal_operator::request::silent;
use oqtal_screen::MonitorArgs;

/// Real-time attitude control for indoor flight laboratories
///
/// Without a command: flies the square with the law `oqtal` through three processes in real time.
#[derive(Parser, Debug)]
#[command(name = "oqtal", version, args_conflicts_with_subcommands = true, max_term_width = 80)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fly: FlyArgs,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Fly a trajectory: start the processes, take off, fly, land, print errors and latencies, write a report
    Fly(Box<FlyArgs>),
    /// Compare the attitude laws over many simulated flights
    Campaign(CampaignArgs),
    /// Fly laws over values of any keys of the configuration, and write a table
    Sweep(SweepArgs),
    /// Reproduce the tables and figures of the paper, beside the printed values
    Reproduce(ReproduceArgs),
    /// Fly every law on plants that differ from their model, and show its margins
    Robustness(RobustnessArgs),
    /// Tune gains on simulated flights
    Tune(TuneArgs),
    /// Identify a vehicle from recordings of its flights, or from a simulated flight: delays, lags, gains, drag, with intervals
    Identify(Box<IdentifyArgs>),
    /// Compare the emulated cameras with recordings of real ones, and estimators on both
    #[command(subcommand)]
    Cameras(CamerasCommand),
    /// Send a command to a running daemon, or show the status of its instance
    Ctl(CtlArgs),
    /// Pass references and requests of programs in any language to a running daemon
    #[command(subcommand)]
    Gateway(GatewayCommand),
    /// Show a running instance in this terminal
    Monitor(MonitorArgs),
    /// Show a running instance or a recording on a page in the browser
    View(ViewArgs),
    /// Record a running instance
    Record(RecordArgs),
    /// Show the contents of a recording: version, machine, topics, rates
    Info(InfoArgs),
    /// Make the report of a flight from its recording
    Report(ReportArgs),
    /// Write a recording as text files for other tools
    Export(ExportArgs),
    /// Compare recorded flights: errors, latencies, settings that differ
    Compare(CompareArgs),
    /// Execute the daemon on the inputs of a recording: the same commands bit for bit, or other settings
    Replay(ReplayArgs),
    /// Measure the latency of each hop of the loop beside that of the bare operating system
    Latency(LatencyArgs),
    /// Check whether this machine is ready to fly, and what would improve it
    Doctor(DoctorArgs),
    /// Print the effective configuration of a file
    Check(CheckArgs),
    /// Run the controller process
    #[command(subcommand)]
    Daemon(ProcessCommand),
    /// Run the simulator process: a simulated vehicle
    #[command(subcommand)]
    PlantSim(oqtal_plant_sim::PlantCommand),
    /// Run the motion-capture process: emulated cameras, or a recording
    #[command(subcommand)]
    MocapEmu(oqtal_mocap_emu::MocapCommand),
    /// Run the bridge process: a real vehicle over a radio
    #[command(subcommand)]
    Bridge(oqtal_bridge::BridgeCommand),
    /// Run the receiver process: poses of a real camera system; find and examine camera systems
    #[command(subcommand)]
    Receiver(oqtal_receiver::ReceiverCommand),
    /// Run receiver and daemon in one loop that writes commands to the port of the bridge
    #[command(subcommand)]
    Chain(ChainCommand),
    /// Print the completions of a shell
    #[command(hide = true)]
    Completions(CompletionsArgs),
    /// Write the manual pages
    #[command(hide = true)]
    Man(ManArgs),
    /// Run a measuring process of `latency`
    #[command(hide = true)]
    LatencyPart(PartArgs),
}

impl Cli {
    /// Executes the command and returns its exit code.
    pub fn execute(self) -> ExitCode {
        let name = self.name();
        let result = match self.command {
            None => self.fly.execute(),
            Some(Command::Fly(args)) => args.execute(),
            Some(Command::Campaign(args)) => {
                args.execute(&|at, resumed| Ok(Box::new(BusFlightSeries::begin(at, resumed)?)))
            }
            Some(Command::Sweep(args)) => args.execute(),
            Some(Command::Reproduce(args)) => args.execute(),
            Some(Command::Robustness(args)) => args.execute(),
            Some(Command::Tune(args)) if args.live.live => live_tuning::execute(&args),
            Some(Command::Tune(args)) => args.execute(),
            Some(Command::Identify(args)) => args.execute(&recordings::read_flight),
            Some(Command::Cameras(command)) => command.execute(),
            Some(Command::Ctl(args)) => args.execute(),
            Some(Command::Gateway(command)) => command.execute(),
            Some(Command::Monitor(args)) => args.execute(oqtal_operator::execute_line, silent),
            Some(Command::View(args)) => args.execute(),
            Some(Command::Record(args)) => args.execute(),
            Some(Command::Info(args)) => args.execute(),
            Some(Command::Report(args)) => args.execute(),
            Some(Command::Export(args)) => args.execute(),
            Some(Command::Compare(args)) => args.execute(),
            Some(Command::Replay(args)) => args.execute(),
            Some(Command::Latency(args)) => args.execute(),
            Some(Command::Doctor(args)) => args.execute(),
            Some(Command::Check(args)) => args.execute(),
            Some(Command::Completions(args)) => args.execute(Self::command()),
            Some(Command::Man(args)) => args.execute(Self::command()),
            Some(Command::LatencyPart(args)) => return args.execute(),
            Some(Command::Daemon(command)) => {
                return execute(Role::Daemon, &command, oqtal_daemon::run, oqtal_daemon::check);
            }
            Some(Command::PlantSim(command)) => return command.execute(),
            Some(Command::Bridge(command)) => return command.execute(),
            Some(Command::Receiver(command)) => return command.execute(),
            Some(Command::MocapEmu(command)) => return command.execute(),
            Some(Command::Chain(command)) => return command.execute(),
        };
        result.map_or_else(|failure| fail(&name, &failure), Into::into)
    }

    /// Name of the command, or of the request of `ctl`.
    fn name(&self) -> String {
        match &self.command {
            Some(Command::Ctl(args)) => args.name(),
            _ => command_word(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_fits(command: &mut clap::Command) {
        for help in [command.render_help(), command.render_long_help()] {
            let help = help.to_string();
            let long = help.lines().find(|line| line.chars().count() > 80);
            assert_eq!(long, None, "{}", command.get_name());
        }
        command.get_subcommands_mut().for_each(assert_fits);
    }

    #[test]
    fn every_help_fits_80_columns() {
        let mut command = Cli::command();
        command.build();
        assert_fits(&mut command);
    }
}
