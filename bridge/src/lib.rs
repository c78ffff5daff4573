//! The bridge process: passes commands from the bus to a real vehicle over a serial port or a radio, in place of the plant.
//!
//! | file | subject | independent of |
//! |---|---|---|
//! | `safety.rs` | selection of the set-point: the newest command within its timeout, else zero | format, transport |
//! | `motors.rs` | state machine of the motors | format, transport |
//! | `schedule.rs`, `timing.rs` | instants at which frames are sent; times of the configuration | format, transport |
//! | `setpoint.rs`, `protocol.rs` | interface to a wire format | transport, safety |
//! | `transport.rs`, `link.rs` | interfaces of transports and ports | format, safety |
//! | `asctec.rs` | wire format of the AscTec Hummingbird | transport, safety |
//! | `crtp.rs` | protocol of the Crazyflie | transport, safety |
//! | `radio.rs` | Crazyradio: schedule, USB, several bridges on one radio | format, safety |
//! | `mavlink.rs` | protocol of PX4 and ArduPilot | transport, safety |
//! | `msp.rs` | protocol of Betaflight | transport, safety |
//! | `xbee.rs`; `serial.rs`, `udp.rs`, `tcp.rs`, `internet.rs` | packets of an XBee; ports | format, safety |
//! | `line.rs`, `outbox.rs` | occupancy of the line; the frame on its way out | format |
//! | `poses.rs` | poses on their way to a vehicle that estimates its own motion | format, transport |
//! | `monitor.rs`, `round_trips.rs` | state of the vehicle and of a network as replies show it | format, transport |
//! | `bridge.rs` | the bridge of all these, pure | |
//! | `setup.rs`, `options.rs` | protocol, transport and port that the configuration asks for | |
//! | `vehicle_setup.rs`, `wanted.rs` | the command `setup`: parameters of an autopilot, and their rules | |
//! | `lender.rs`, `tenant.rs`, `borrower.rs` | the port lent to another process, at both ends | safety |
//! | `turn.rs`, `background.rs`, `note.rs` | the turn of the real-time thread; the background thread; its log | |
//!
//! The bridge is the second of three lines of safety, each independent of the others: the daemon checks poses, the bridge checks
//! the age of the daemon's commands by its own clock, systemd restarts processes that ended.
#![forbid(unsafe_code)]

mod asctec;
mod background;
mod borrower;
mod bridge;
mod crtp;
mod internet;
mod lender;
mod line;
mod link;
mod mavlink;
mod monitor;
mod motors;
mod msp;
mod note;
mod options;
mod outbox;
mod poses;
mod protocol;
mod radio;
mod round_trips;
mod safety;
mod schedule;
mod serial;
mod setpoint;
mod setup;
mod tcp;
mod tenant;
mod timing;
mod transport;
mod turn;
mod udp;
mod vehicle_setup;
mod wanted;
mod xbee;

use std::rc::Rc;

use clap::{Args, Subcommand};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, Role};
use oqtal_config::{Config, FaultTarget};
use oqtal_runtime::background::with_background;
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::handoff::handoff;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_runtime::process_loop;
use oqtal_runtime::program::{conclude, print};
use oqtal_wire::link::{InvalidLink, LinkSpec};

use background::PortKeeper;
use lender::PortLender;
use link::{PortOpenError, PortOptions};
use radio::{RadioShareOptions, SharedVehicle, share_radio};
use setup::VehicleSetup;
use vehicle_setup::set_up;

pub use asctec::Asctec;
pub use borrower::PortBorrower;
pub use bridge::{Bridge, VehicleReport};
pub use crtp::{Crtp, TableStore};
pub use line::LineOccupancy;
pub use link::VehicleLink;
pub use mavlink::Mavlink;
pub use motors::MotorEvent;
pub use msp::Msp;
pub use note::Note;
pub use options::{check as check_options, link};
pub use protocol::{FrameSizes, MAX_FRAME, ReportedMotors, VehicleFrame, VehicleProtocol};
pub use radio::{RadioAck, RadioCounts, RadioDongle, RadioWorker};
pub use safety::{CommandGate, ForwardedCommand, MotorStatus, SafetyLimits};
pub use setpoint::VehicleSetpoint;
pub use setup::transport;
pub use tenant::{PortPart, PortTenant};
pub use transport::{BareTransport, VehicleTransport};
pub use turn::{BridgePorts, BridgeTurn};

/// Commands of the bridge's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum BridgeCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(BridgeArgs),
    /// Check the configuration the process would run with, and print it
    Check(BridgeArgs),
    /// Share one Crazyradio among the bridges of several Crazyflies until SIGINT or SIGTERM
    Radio(RadioArgs),
    /// Read the parameters of a vehicle that matter, say which are wrong and why, and set them when asked
    Setup(SetupArgs),
}

/// Arguments of `bridge radio`.
#[derive(Args, Clone, Debug)]
pub struct RadioArgs {
    /// A vehicle, and the address for its bridge: CHANNEL/RATE/ADDRESS@IP:PORT, as 80/2M/E7E7E7E701@127.0.0.1:19851, for a bridge with
    /// --link crtp:udp:127.0.0.1:19851. May be repeated
    #[arg(long = "vehicle", value_name = "VEHICLE", required = true)]
    vehicles: Vec<SharedVehicle>,
    /// Most packets beside set-points for each vehicle \[1/s\]
    #[arg(long, value_name = "N", default_value_t = 250)]
    packets_per_s: u16,
    /// Send poses of two vehicles on one channel in one packet that both receive and none acknowledges: fewer packets; needs radio
    /// firmware that receives at the address FFE7E7E7E7, such as that of Crazyflie 2.1
    #[arg(long)]
    pack_poses: bool,
}

/// Arguments of the setup.
#[derive(Args, Clone, Debug)]
pub struct SetupArgs {
    /// Where the vehicle is, as for `run`
    #[arg(value_name = "LINK")]
    link: String,
    /// Set what is wrong, and read it back
    #[arg(long)]
    apply: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Arguments of the bridge's command line.
#[derive(Args, Clone, Debug)]
pub struct BridgeArgs {
    /// Where the vehicle is
    #[arg(long, value_name = "LINK", help = link_help())]
    link: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

fn link_help() -> String {
    format!("Where the vehicle is: {}", LinkSpec::forms().join("; "))
}

impl BridgeCommand {
    /// Executes the command; returns the exit code of the process.
    pub fn execute(self) -> std::process::ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
            Self::Radio(args) => return args.execute(),
            Self::Setup(args) => {
                return match args.execute() {
                    Ok(exit) => exit.into(),
                    Err(failure) => conclude("oqtal bridge setup", &failure),
                };
            }
        };
        execute(Role::Bridge, &command, run, check)
    }
}

impl RadioArgs {
    fn execute(self) -> std::process::ExitCode {
        let packets_per_s = f64::from(self.packets_per_s.max(50));
        let options = RadioShareOptions { packets_per_s, packs_poses: self.pack_poses };
        match share_radio(&self.vehicles, options) {
            Ok(()) => std::process::ExitCode::SUCCESS,
            Err(failure) => conclude("oqtal bridge radio", &failure),
        }
    }
}

impl SetupArgs {
    fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let spec: LinkSpec = self
            .link
            .parse()
            .map_err(|error: InvalidLink| Failure::new(Exit::Usage, error.to_string()))?;
        let (table, all_right) = set_up(&config, &spec, self.apply)?;
        print(table.trim_end())?;
        Ok(if all_right { Exit::Ok } else { Exit::Flight })
    }
}

impl BridgeArgs {
    /// The arguments that every process has: the link becomes a setting.
    fn common(self) -> CommonArgs {
        let Self { link, mut common } = self;
        common.settings.extend(link.map(|link| format!("bridge.link={link}")));
        common
    }
}

/// Checks whether the bridge could run with `config`.
///
/// # Errors
/// There is no link, or it is malformed or too slow (exit code 78), or the clock is virtual (64).
pub fn check(config: &Config) -> Result<(), Failure> {
    VehicleSetup::of(config).map(drop)
}

/// Time for which a bridge that starts waits for a port that another process holds, and time between two attempts.
const HELD_TIMEOUT: Span = Span::from_millis(2000);
const HELD_POLL: std::time::Duration = std::time::Duration::from_millis(50);

/// Opens `port`; waits for a limited time if another process still holds it, such as a chain that borrowed it from the previous bridge.
fn open_free(port: &dyn PortOptions) -> Result<Box<dyn VehicleLink>, PortOpenError> {
    let give_up = Time::now() + HELD_TIMEOUT;
    loop {
        match port.open() {
            Err(PortOpenError::Busy { .. } | PortOpenError::AddressInUse { .. })
                if Time::now() < give_up =>
            {
                std::thread::sleep(HELD_POLL);
            }
            opened => return opened,
        }
    }
}

/// Passes commands to the vehicle until a stop is requested; leaves it with a zero set-point.
///
/// # Errors
/// Like [`check`]; the port cannot be opened; the bus refuses or breaks.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let setup = VehicleSetup::of(&context.config)?;
    setup.warn_of_broadcast(&context.config);
    setup.warn_of_short_start(&context.config);
    let VehicleSetup { spec, protocol, transport, port, table_keeper } = setup;
    let bus = Rc::new(context.bus()?);
    let faulty = FaultyTransport::new(&bus, &context.config)?;
    let ports = BridgePorts::open(&faulty, protocol.pose_period().is_some())?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut clock = context.loop_clock(&bus, &COMMAND)?;
    let link = open_free(&*port).map_err(PortOpenError::of_run)?;
    let key = options::key_fingerprint(&context.config);
    let lender = PortLender::open(bus.paths().chain(), spec.clone(), key, &*link);
    // A bridge needs no chain.
    let lender = lender.inspect_err(|failure| tracing::warn!("{failure}")).ok();
    tracing::info!(link = spec.to_string(), "the port is open");
    let mut bridge = Bridge::new(&context.config, protocol, transport, clock.now());
    bridge.open(clock.now());
    let (handle, background) = handoff();
    with_background(
        context,
        || Ok(PortKeeper::new(background, port, spec, table_keeper, lender)),
        || {
            context.enter_realtime();
            let health = context.health.clone();
            let (link, tenant) = (Some(link), None);
            let turn = BridgeTurn { ports, bridge, link, tenant, handle, health };
            let mut turn = faulty.turn(FaultTarget::Bridge, turn);
            Ok(process_loop::run(&mut turn, &mut clock, Some(&mut heartbeat))?)
        },
    )
}
