//! The plant process: a simulated vehicle and its radio, in place of a real one.
//!
//! [`Plant`] is pure; [`run`] wires it to the bus, or puts it at the other end of a radio's wire ([`wire`]).
#![forbid(unsafe_code)]

mod dynamics;
mod plant;
mod spread;
mod state;
pub mod wire;
mod world;

use clap::{Args, Subcommand};
use oqtal_bus::message::HealthV1;
use oqtal_bus::topic::{COMMAND, Role, TRUTH, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_wire::link::LinkSpec;

pub use dynamics::{Disturbance, Dynamics, Input};
pub use plant::{Output, Plant};
pub use state::{Derivative, State};

/// What can be done with the plant.
#[derive(Subcommand, Clone, Debug)]
pub enum PlantCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(PlantArgs),
    /// Check the configuration the process would run with, and print it
    Check(PlantArgs),
}

/// What the plant can be told on its command line.
#[derive(Args, Clone, Debug)]
pub struct PlantArgs {
    /// Be flown over a wire, at asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]: PATH becomes a link to a pseudo-terminal
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

/// The link that the vehicle is to be found at, if its commands come over a wire.
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
    let bus = context.bus()?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut truths = bus.writer(&TRUTH)?;
    // Of a vehicle behind the bridge it is the bridge that speaks.
    let own = !context.config.plant.shadow;
    let mut vehicles = own.then(|| bus.writer(&VEHICLE)).transpose()?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut pace = context.pace(&bus, &COMMAND)?;
    let mut plant = Plant::new(&context.config, pace.now());
    let mut outputs = Vec::with_capacity(64);
    context.enter_realtime();
    loop {
        let next = if pace.is_virtual() { plant.next_event() } else { plant.next_sample() };
        if pace.wait(Some(next))?.is_none() {
            return Ok(());
        }
        heartbeat.beat(HealthV1::default())?;
        let arrival = commands.latest()?;
        // After the command was taken: it must not look as if it had come before it was sent.
        let now = pace.now();
        plant.advance(now, |output| outputs.push(output));
        if let Some((header, command)) = arrival {
            context.health.heard();
            plant.receive(now, header, command, commands.lost());
            // The truth at the tick itself, for those who judge the flight.
            outputs.push(Output::Truth(plant.truth()));
        }
        for output in outputs.drain(..) {
            match output {
                Output::Truth(truth) => {
                    truths.send(truth.capture, Default::default(), truth)?;
                    if truth.capture > 0 {
                        pace.announce(&truths)?;
                    }
                }
                Output::Applied(pose_sequence, stamps, vehicle) => {
                    if let Some(vehicles) = &mut vehicles {
                        vehicles.send(pose_sequence, stamps, vehicle)?;
                    }
                }
            }
        }
    }
}
