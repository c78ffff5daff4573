//! The receiver's command line.

use std::process::ExitCode;

use clap::{Args, Subcommand};
use oqtal_bus::time::Span;
use oqtal_bus::topic::Role;
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, ProcessCommand, execute};
use oqtal_runtime::program::{conclude, print, say};
use serde::Serialize;

use crate::discover::discover;
use crate::probe::{FitnessVerdict, probe};
use crate::process::{check, run};
use oqtal_wire::link::{CameraLink, InvalidLink};

/// Commands of the receiver's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum ReceiverCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(ReceiverArgs),
    /// Check the configuration the process would run with, and print it
    Check(ReceiverArgs),
    /// Find camera systems in the network, and their bodies
    Discover(DiscoverArgs),
    /// Examine a camera system: is it fit to fly with?
    Probe(ProbeArgs),
}

/// Arguments of the receiver's command line.
#[derive(Args, Clone, Debug)]
pub struct ReceiverArgs {
    /// Where the cameras are: qtm:HOST[:PORT], vrpn:HOST[:PORT] or natnet:HOST, with body=NAME[@INSTANCE] for each vehicle; for the
    /// options see docs/cameras.md
    #[arg(long, value_name = "LINK")]
    link: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Arguments of `discover`.
#[derive(Args, Clone, Debug)]
pub struct DiscoverArgs {
    /// Hosts that are asked besides this one and those that broadcasts reach
    hosts: Vec<String>,
    /// Time to wait for answers [s]
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=60))]
    seconds: u32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Arguments of `probe`.
#[derive(Args, Clone, Debug)]
pub struct ProbeArgs {
    /// Where the cameras are; without body=NAME all bodies are examined
    link: String,
    /// Duration of the examination [s]
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
    seconds: u32,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl ReceiverCommand {
    /// Executes the command; returns the exit code of the process.
    pub fn execute(self) -> ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
            Self::Discover(args) => return finish("oqtal receiver discover", args.execute()),
            Self::Probe(args) => return finish("oqtal receiver probe", args.execute()),
        };
        execute(Role::Receiver, &command, run, check)
    }
}

fn finish(program: &str, result: Result<Exit, Failure>) -> ExitCode {
    match result {
        Ok(exit) => exit.into(),
        Err(failure) => conclude(program, &failure),
    }
}

impl ReceiverArgs {
    /// The arguments that every process has: the link becomes a setting.
    pub fn common(self) -> CommonArgs {
        let Self { link, mut common } = self;
        common.settings.extend(link.map(|link| format!("receiver.link={link}")));
        common
    }
}

impl DiscoverArgs {
    fn execute(&self) -> Result<Exit, Failure> {
        let duration = Span::from_millis(i64::from(self.seconds) * 1000);
        let discovery = discover(&self.hosts, duration)?;
        discovery.notes().for_each(|text| say(&text));
        let found = discovery.found;
        if found.is_empty() {
            let nobody = match self.hosts.is_empty() {
                false => "no camera system answers",
                true => {
                    "no camera system answers on the usual ports of this machine, or by broadcast; name its computer, and a port of its own, as in `oqtal receiver discover HOST:PORT`"
                }
            };
            return Err(Failure::new(Exit::Peer, nobody));
        }
        let lines = || found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        print(&if self.json { json(&found) } else { lines() })?;
        Ok(Exit::Ok)
    }
}

impl ProbeArgs {
    fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let link: Result<CameraLink, InvalidLink> = self.link.parse();
        let link = link.map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
        let duration = Span::from_millis(i64::from(self.seconds) * 1000);
        let figures = probe(&link, &config, duration)?;
        print(&if self.json { json(&figures) } else { figures.to_string() })?;
        Ok(if figures.verdict == FitnessVerdict::Unfit { Exit::Data } else { Exit::Ok })
    }
}

fn json(document: &impl Serialize) -> String {
    serde_json::to_string_pretty(document).expect("figures hold only what JSON can say")
}
