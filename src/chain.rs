//! `oqtal chain`: receiver and daemon in one loop, which also writes the flight commands to the port of the bridge. From the datagram of
//! the cameras to that of the command no process waits for another one.
//!
//! The bridge remains a process of its own and still enforces its safety rules: it opens the port and lends it, and sends every other
//! set-point, also when the chain ends or hangs.

use std::process::ExitCode;

use clap::Subcommand;
use oqtal_bridge::PortBorrower;
use oqtal_bus::bus::Bus;
use oqtal_bus::time::Span;
use oqtal_bus::topic::{Role, VEHICLE};
use oqtal_config::{Config, FaultTarget};
use oqtal_receiver::{ReceiverArgs, ReceiverParts};
use oqtal_runtime::awake::AwakeInterval;
use oqtal_runtime::background::with_background;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure, ProcessCommand, ProcessContext, execute_as};

/// Commands of the chain's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum ChainCommand {
    /// Run the process until SIGINT or SIGTERM, beside a running `oqtal bridge run`
    Run(ReceiverArgs),
    /// Check the configuration the process would run with, and print it
    Check(ReceiverArgs),
}

impl ChainCommand {
    /// Executes the command; returns the exit code of the process.
    pub fn execute(self) -> ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
        };
        execute_as("chain", Role::Daemon, &command, (run, check))
    }
}

/// Whether receiver and daemon could run with `config`.
fn check(config: &Config) -> Result<(), Failure> {
    if config.fault.inject.iter().any(|fault| fault.target == FaultTarget::Command) {
        let reason = "`fault.inject` cannot alter commands that the chain sends past the bus; fly with `oqtal receiver run` and `oqtal daemon run`, or with `oqtal fly` without --chain";
        return Err(Failure::new(Exit::Usage, reason));
    }
    oqtal_receiver::check(config)?;
    oqtal_daemon::check(config)
}

/// Flies with the poses of a camera system until a stop is requested.
fn run(context: &ProcessContext) -> Result<(), Failure> {
    check(&context.config)?;
    require_bridge(context)?;
    let cameras = context.of_part(Role::Receiver);
    let ReceiverParts { turn, descriptor, connector, buses: _buses } =
        oqtal_receiver::open(&cameras)?;
    // Last: while the cameras are being connected, nobody returns the port to a bridge that restarts; it waits only 2 s for it.
    let (borrower, writer) = PortBorrower::open(&context.paths()?.chain(), &context.config)?;
    let period = Span::period_of(context.config.control.rate_hz);
    let awake = AwakeInterval::of(&context.config, context.role);
    let clock = LoopClock::polled(descriptor, context.stop.clone())
        .counted_in(context.health.clone(), period)
        .awake_in(awake);
    with_background(
        &cameras,
        || Ok((borrower, connector)),
        || oqtal_daemon::run_behind(context, turn, |_| Ok(clock), Some(Box::new(writer))),
    )
}

/// Fails unless a bridge runs on this instance.
fn require_bridge(context: &ProcessContext) -> Result<(), Failure> {
    let bus = Bus::open(&context.paths()?)?;
    let flags = bus.paths().flags();
    let reason = match bus.holder(&VEHICLE)? {
        Some(it) if it.contains("plant-sim") => format!(
            "{it} has the vehicle, which takes commands from the bus: a chain is for a vehicle behind a bridge; run `oqtal receiver run {flags}` and `oqtal daemon run {flags}`"
        ),
        Some(_) => return Ok(()),
        None => format!(
            "no bridge runs on this instance; start `oqtal bridge run {flags} --link LINK` first"
        ),
    };
    Err(Failure::new(Exit::Peer, reason))
}
