//! The plant process: a simulated vehicle and its radio, in place of real ones.
//!
//! [`Plant`] is pure. [`run`] connects it to the bus, to the far end of a radio's wire ([`wire`]), or to a firmware that runs as
//! a program ([`firmware`]); alternatively it publishes the truth of an autopilot's own simulator ([`autopilot`]).
//!
//! | file | subject |
//! |---|---|
//! | `plant.rs` | the simulated vehicle, integrated from event to event |
//! | `dynamics.rs` | equations of motion |
//! | `input.rs` | their inputs: command and disturbance |
//! | `state.rs` | state of motion and its integration |
//! | `world.rs` | gusts, drift, battery, floor |
//! | `gyroscope.rs` | the gyroscope of the simulated vehicle |
//! | `disturbance.rs` | timed disturbances, `plant.disturb` |
//! | `spread.rs` | parameter spread of the vehicle |
//! | `turn.rs` | one turn over the plant's ports |
//! | `rotors.rs` | aerodynamic forces on the rotors |
//! | `command_radio.rs` | delay, jitter and losses of commands |
//! | `wire.rs` | the vehicle at the far end of a wire |
//! | `firmware.rs` | the body of a firmware that runs as a program, of a Crazyflie or Betaflight |
//! | `autopilot.rs` | the truth of an autopilot's own simulator |
//! | `socket.rs` | UDP sockets for programs beside the plant |
//! | `truth.rs` | ports of a vehicle that is not commanded over the bus |
#![forbid(unsafe_code)]

pub mod autopilot;
mod command_radio;
mod disturbance;
mod dynamics;
pub mod firmware;
mod gyroscope;
mod input;
mod plant;
mod rotors;
mod socket;
mod spread;
mod state;
mod truth;
mod turn;
pub mod wire;
mod world;

use std::rc::Rc;

use clap::builder::UnknownArgumentValueParser;
use clap::{Args, Subcommand};
use oqtal_bus::topic::{COMMAND, Role};
use oqtal_config::{Config, FaultTarget, parse_option};
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::process::{CommonArgs, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_runtime::process_loop;
use oqtal_wire::link::{LinkSpec, TruthSource};

pub use command_radio::CommandLoss;
pub use disturbance::{AppliedLoad, DisturbanceClock, LoadSchedule, SceneDisturbance};
pub use dynamics::Dynamics;
pub use input::{Disturbance, PlantInput};
pub use plant::{Plant, PlantOutput};
pub use rotors::RotorAir;
pub use spread::drawn;
pub use state::{Derivative, EquationsOfMotion, State};
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
    /// mavlink:udpout:HOST:PORT, mavlink:udpin:HOST:PORT, crtp:udp:HOST:PORT, or msp:udpin:HOST:PORT
    #[arg(long, value_name = "LINK")]
    wire: Option<String>,
    /// Be the body of a firmware that runs as a program, crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT] or
    /// betaflight-sitl:udp:HOST:PORT[,state=HOST:PORT], or publish the truth of an autopilot's own simulator, mavlink:udpin:HOST:PORT
    #[arg(long, value_name = "LINK", conflicts_with = "wire")]
    truth: Option<String>,
    // Known to `fly`: the error names the option of this command.
    #[arg(long = "plant", hide = true, value_parser = UnknownArgumentValueParser::suggest_arg("--set").and_suggest("write --set plant.KEY=VALUE"))]
    _plant: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

impl PlantCommand {
    /// Executes the command and returns its exit code.
    pub fn execute(self) -> std::process::ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
        };
        execute(Role::Plant, &command, run, check)
    }
}

impl PlantArgs {
    /// The arguments of any process; wire and truth become settings.
    fn common(self) -> CommonArgs {
        let Self { wire, truth, mut common, .. } = self;
        common.settings.extend(wire.map(|link| format!("plant.wire.link={link}")));
        common.settings.extend(truth.map(|link| format!("plant.truth={link}")));
        common
    }
}

/// Checks that the plant can run with `config`.
///
/// # Errors
/// The link of the wire, or the source of the truth, is invalid.
pub fn check(config: &Config) -> Result<(), Failure> {
    link(config)?;
    truth_source(config).map(drop)
}

/// The source of the truth that `plant.truth` names; `None` if the key is empty and the vehicle is simulated.
fn truth_source(config: &Config) -> Result<Option<TruthSource>, Failure> {
    let source = parse_option("plant.truth", &config.plant.truth, "a source");
    source.map_err(|error| config.locate(&error).into())
}

/// The link that `plant.wire.link` names; `None` if the key is empty and commands come over the bus.
fn link(config: &Config) -> Result<Option<LinkSpec>, Failure> {
    wire::link(config).map_err(|error| config.locate(&error).into())
}

/// Runs the simulated vehicle. Returns when a stop is requested.
///
/// # Errors
/// The bus refuses or fails.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    if let Some(source) = truth_source(&context.config)? {
        return follow(context, source);
    }
    match link(&context.config)? {
        Some(link) => wire::run(context, &link),
        None => fly(context),
    }
}

/// Publishes the truth of a firmware that runs as a program.
fn follow(context: &ProcessContext, source: TruthSource) -> Result<(), Failure> {
    match source {
        TruthSource::CrazyflieSitl { body, crtp } => {
            firmware::run(context, firmware::BodyAddresses { body, crtp })
        }
        TruthSource::BetaflightSitl { motors, state } => {
            firmware::betaflight::run(context, (motors, state))
        }
        TruthSource::Mavlink(address) => autopilot::run(context, address),
    }
}

/// Runs the vehicle with the commands on the bus.
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
