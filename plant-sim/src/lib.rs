//! The plant process: a simulated vehicle and its radio, in place of a real one.
//!
//! [`Plant`] is pure; [`run`] wires it to the bus, or puts it at the other end of a radio's wire ([`wire`]).
#![forbid(unsafe_code)]

mod dynamics;
mod plant;
mod spread;
mod state;
mod turn;
pub mod wire;
mod world;

use std::rc::Rc;

use clap::{Args, Subcommand};
use oqtal_bus::topic::{COMMAND, Role};
use oqtal_config::{Config, FaultTarget};
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::process::{CommonArgs, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_runtime::process_loop;
use oqtal_wire::link::LinkSpec;

pub use dynamics::{Disturbance, Dynamics, PlantInput};
pub use plant::{Plant, PlantOutput};
pub use state::{Derivative, State};
pub use turn::{PlantTurn, Stepping};

/// Commands of the simulator's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum PlantCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(PlantArgs),
    /// Check the configuration the process would run with, and print it
    Check(PlantArgs),
}

/// Arguments of the simulator's command line.
#[derive(Args, Clone, Debug)]
pub struct PlantArgs {
    /// Receive commands at the wire asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]: PATH becomes a link to a pseudo-terminal;
    /// mavlink:udpout:HOST:PORT, mavlink:udpin:HOST:PORT, or crtp:udp:HOST:PORT
    #[arg(long, value_name = "LINK")]
    wire: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

impl PlantCommand {
    /// Does it, and says how it ended.
    #[must_use]
    pub fn execute(self) -> std::process::ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
        };
        execute(Role::Plant, &command, run, check)
    }
}

impl PlantArgs {
    /// The same for any process: the wire is a setting.
    fn common(self) -> CommonArgs {
        let Self { wire, mut common } = self;
        common.settings.extend(wire.map(|link| format!("plant.wire.link={link}")));
        common
    }
}

/// Whether the plant could fly with `config`.
///
/// # Errors
/// The wire's link has no meaning.
pub fn check(config: &Config) -> Result<(), Failure> {
    link(config).map(drop)
}

/// The link that `plant.wire.link` names; `None` if the key is empty and commands come over the bus.
fn link(config: &Config) -> Result<Option<LinkSpec>, Failure> {
    wire::link(config).map_err(|error| config.locate(&error).into())
}

/// Flies the simulated vehicle until asked to stop.
///
/// # Errors
/// The bus refuses or breaks.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    match link(&context.config)? {
        Some(link) => wire::run(context, &link),
        None => fly(context),
    }
}

/// Flies by the commands on the bus.
fn fly(context: &ProcessContext) -> Result<(), Failure> {
    let bus = Rc::new(context.bus()?);
    let faulty = FaultyTransport::new(&bus, &context.config)?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut clock = context.loop_clock(&bus, &COMMAND)?;
    let stepping = if clock.is_virtual() { Stepping::Exact } else { Stepping::Sampled };
    let plant = Plant::new(&context.config, clock.now());
    let turn = PlantTurn::open(&faulty, plant, stepping, &context.config)?;
    let mut turn = faulty.turn(FaultTarget::PlantSim, turn.counted_in(context.health.clone()));
    context.enter_realtime();
    Ok(process_loop::run(&mut turn, &mut clock, Some(&mut heartbeat))?)
}
