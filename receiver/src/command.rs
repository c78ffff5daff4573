//! The receiver's command line.

use std::process::ExitCode;

use clap::{Args, Subcommand};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{CommonArgs, ProcessCommand, execute};

use crate::process::{check, run};

/// Commands of the receiver's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum ReceiverCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(ReceiverArgs),
    /// Check the configuration the process would run with, and print it
    Check(ReceiverArgs),
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

impl ReceiverCommand {
    /// Executes the command; returns the exit code of the process.
    #[must_use]
    pub fn execute(self) -> ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
        };
        execute(Role::Receiver, &command, run, check)
    }
}

impl ReceiverArgs {
    /// The arguments that every process has: the link becomes a setting.
    fn common(self) -> CommonArgs {
        let Self { link, mut common } = self;
        common.settings.extend(link.map(|link| format!("receiver.link={link}")));
        common
    }
}
