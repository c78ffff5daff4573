//! The bridge process: a real vehicle over a radio, in the place of the simulated one.
//!
//! | file | subject | knows |
//! |---|---|---|
//! | `safety.rs` | what may be said: the newest command while it is young, else neutral | neither format nor link |
//! | `motors.rs` | the table of motor states | neither format nor link |
//! | `schedule.rs`, `line.rs` | when frames go, and how busy the line is | neither format nor link |
//! | `vehicle.rs` | what is known of the vehicle | neither format nor link |
//! | `protocol.rs` | what is needed of a vehicle's protocol | no format |
//! | `asctec.rs`, `radio.rs` | the AscTec Hummingbird, XBee radios | one format each, in `oqtal-wire` |
//! | `link.rs`, `serial.rs` | what carries bytes; serial ports | one link |
//! | `bridge.rs` | one turn: all of these together, pure | |
//! | `pump.rs` | the loop: bus, port and one turn after the other | |
//! | `background.rs` | logs, opening and closing ports | |
//!
//! The bridge is the second of three lines of safety, and asks neither of the others: the daemon judges poses, the bridge
//! judges the daemon's commands by its own clock, systemd restarts what died.
#![forbid(unsafe_code)]

mod asctec;
mod background;
mod bridge;
mod line;
mod link;
mod motors;
mod options;
mod protocol;
mod pump;
mod radio;
mod safety;
mod schedule;
mod serial;
mod vehicle;

use clap::{Args, Subcommand};
use oqtal_bus::time::Span;
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Interface};
use oqtal_control::options::OptionError;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_wire::link::{LinkSpec, ProtocolKind};
use oqtal_wire::xbee::{Address, Framing};

pub use asctec::Asctec;
pub use background::{BackgroundWorker, Note, RtHandle, rt_handle};
pub use bridge::{Bridge, VehicleReport};
pub use line::LineOccupancy;
pub use link::VehicleLink;
pub use motors::{MotorChange, MotorConditions, MotorSequencer, MotorState};
pub use options::{check as check_options, link};
pub use protocol::{FrameSizes, VehicleFrame, VehicleProtocol, VehicleReply};
pub use radio::through;
pub use safety::{CommandGate, ForwardedCommand, MotorStatus, SafetyLimits, VehicleSetpoint};
pub use schedule::{Schedule, spacing};
pub use serial::{PortOpenError, SerialLink, SerialPortOptions};
pub use vehicle::VehicleMonitor;

/// Of the line's time, commands may take so much.
const GREATEST_OCCUPANCY: f64 = 0.8;

/// What can be done with the bridge.
#[derive(Subcommand, Clone, Debug)]
pub enum BridgeCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(BridgeArgs),
    /// Check the configuration the process would run with, and print it
    Check(BridgeArgs),
}

/// What the bridge can be told on its command line.
#[derive(Args, Clone, Debug)]
pub struct BridgeArgs {
    /// Where the vehicle is: asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]
    #[arg(long, value_name = "LINK")]
    link: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

impl BridgeCommand {
    /// Does it, and says how it ended.
    #[must_use]
    pub fn execute(self) -> std::process::ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
        };
        execute(Role::Bridge, &command, run, check)
    }
}

impl BridgeArgs {
    /// The same for any process: the link is a setting.
    fn common(self) -> CommonArgs {
        let Self { link, mut common } = self;
        common.settings.extend(link.map(|link| format!("bridge.link={link}")));
        common
    }
}

/// Whether the bridge could fly with `config`.
///
/// # Errors
/// There is no link, or one that is too slow (exit code 78), or the clock is not the machine's (64).
pub fn check(config: &Config) -> Result<(), Failure> {
    vehicle(config).map(drop)
}

/// Passes commands on to the vehicle until asked to stop; leaves it neutral.
///
/// # Errors
/// The configuration has no meaning, the port cannot be opened, or the bus refuses or breaks.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let (spec, protocol) = vehicle(&context.config)?;
    let every_radio = options::address(&context.config).is_ok_and(Address::is_broadcast);
    if every_radio && spec.xbee() != Framing::Transparent {
        tracing::warn!(
            "commands go to every radio in reach, and any of them is taken for the vehicle; set `bridge.xbee-address` to that of its radio"
        );
    }
    pump::run(context, &spec, protocol)
}

/// The link of `config`, and the protocol that is spoken there.
fn vehicle(config: &Config) -> Result<(LinkSpec, Box<dyn VehicleProtocol>), Failure> {
    let wrong = |reason: String| Failure::new(Exit::Config, reason);
    if config.clock.kind != ClockKind::Real {
        let reason = "a bridge flies by the machine's clock alone; set `clock.kind = \"real\"`";
        return Err(Failure::new(Exit::Usage, reason));
    }
    if config.vehicle.interface != Interface::Rate {
        let reason = "a bridge passes on sticks, not torque; set `vehicle.interface = \"rate\"`";
        return Err(wrong(reason.to_owned()));
    }
    let located = |error: OptionError| Failure::from(config.locate(&error));
    let spec = options::link(config).map_err(located)?;
    let spec = spec.ok_or_else(|| {
        wrong("`bridge.link` names no vehicle; give --link asctec:PATH, as in --link asctec:/dev/ttyUSB0".to_owned())
    })?;
    let protocol: Box<dyn VehicleProtocol> = match spec.kind() {
        ProtocolKind::Asctec => Box::new(Asctec::new(config).map_err(located)?),
    };
    let peer = options::address(config).map_err(located)?;
    let protocol = radio::through(spec.xbee(), peer, protocol);
    check_room(config, &spec, protocol.sizes()).map_err(wrong)?;
    Ok((spec, protocol))
}

/// Commands, polls and answers must fit on the line.
fn check_room(config: &Config, spec: &LinkSpec, sizes: FrameSizes) -> Result<(), String> {
    let line = LineOccupancy::new(spec.baud());
    let (period, rate) = (Span::period_of(config.control.rate_hz), config.control.rate_hz);
    let baud = spec.baud();
    if line.time_for(sizes.setpoint) > period.scaled(GREATEST_OCCUPANCY) {
        return Err(format!(
            "`bridge.link`: {rate} commands of {} bytes a second take more than {} % of {baud} baud; lower `control.rate-hz`, or use a \
             faster line",
            sizes.setpoint,
            GREATEST_OCCUPANCY * 100.0
        ));
    }
    if bridge::poll_spacing(&line, period, sizes).is_some() {
        return Ok(());
    }
    Err(format!(
        "`bridge.link`: between two of {rate} commands a second there is no room at {baud} baud to ask the vehicle how it is; lower \
         `control.rate-hz`, or use a faster line"
    ))
}
