//! Emulated vehicle at the far end of a wire: the bytes sent by a bridge control the plant.
//!
//! | file | subject |
//! |---|---|
//! | `vehicle.rs` | an emulated vehicle: plant, link, on-board computer, pure |
//! | `link.rs` | interface of the models of links |
//! | `radio.rs` | model of a radio behind a serial port: rate, latency, losses, wrong bits |
//! | `datagrams.rs` | model of a network: latency, jitter, losses |
//! | `asctec.rs` | on-board computer of an AscTec vehicle, with its pseudo-terminal |
//! | `autopilot.rs` | autopilot controlled over MAVLink |
//! | `crazyflie.rs` | Crazyflie controlled over CRTP |
//! | `msp.rs` | vehicle with Betaflight, controlled over MSP |
//! | `command.rs` | commands of on-board loops |
//! | `schedule.rs` | schedule of periodic messages |

mod asctec;
mod autopilot;
mod command;
mod crazyflie;
mod datagrams;
mod link;
mod msp;
mod radio;
mod schedule;
mod vehicle;

use std::path::Path;

use oqtal_bus::bus::Bus;
use oqtal_bus::time::Time;
use oqtal_config::{Config, parse_option};
use oqtal_control::options::OptionError;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use oqtal_wire::link::{CrtpLink, LinkSpec, PortSpec};

use crate::PlantOutput;
use crate::disturbance::DisturbanceClock;
use crate::socket::{PeerSocket, VehiclePort};
use crate::truth::TruthPorts;
use crate::turn::log_skipped;

pub use asctec::{AsctecComputer, AsctecVehicle};
pub use autopilot::{EmulatedAutopilot, MavlinkVehicle};
pub use crazyflie::{CrazyflieBoard, CrtpVehicle};
pub use datagrams::DatagramModel;
pub use link::{LinkDirection, LinkModel, Traffic};
pub use msp::{MspBoard, MspVehicle};
pub use radio::RadioModel;
pub use vehicle::{EmulatedVehicle, FrameCounters, LinkCounters, Measured, OnBoardComputer};

/// Size of the read buffer \[bytes\]; the longest packet is shorter.
const CHUNK: usize = 2048;
/// Maximum number of reads in one turn \[-\].
const MAX_READS: usize = 16;

/// Name of the vehicle in error messages about its port.
const USER: &str = "the emulated vehicle";

/// Link of the emulated vehicle; `None` if its commands come over the bus.
///
/// # Errors
/// `[plant.wire]` is invalid.
pub fn link(config: &Config) -> Result<Option<LinkSpec>, OptionError> {
    asctec::check(config)?;
    parse_option("plant.wire.link", &config.plant.wire.link, "a link")
}

/// Runs the emulated vehicle at `link`. Returns when a stop is requested. The vehicle's state is reported over the wire only; the
/// truth is published for the cameras.
///
/// # Errors
/// The link cannot be made, or the bus refuses or fails.
pub fn run(context: &ProcessContext, link: &LinkSpec) -> Result<(), Failure> {
    // Joining the instance first removes a link left in its directory by a killed vehicle.
    let bus = context.bus()?;
    let (config, now) = (&context.config, Time::now());
    let located = |error: OptionError| Failure::from(config.locate(&error));
    let shown = link.to_string();
    match link {
        LinkSpec::Asctec(link) => {
            let port = asctec::PseudoTerminal::open(Path::new(&link.serial.path))?;
            let vehicle = AsctecVehicle::new(config, link, now).map_err(located)?;
            fly(context, &bus, port, (vehicle, shown))
        }
        LinkSpec::Mavlink(link) => {
            let port = udp_port(&link.port)?;
            let vehicle = MavlinkVehicle::new(config, link, now).map_err(located)?;
            fly(context, &bus, port, (vehicle, shown))
        }
        LinkSpec::Msp(link) => {
            let port = udp_port(&link.port)?;
            let vehicle = MspVehicle::new(config, now).map_err(located)?;
            fly(context, &bus, port, (vehicle, shown))
        }
        LinkSpec::Crtp(CrtpLink::Udp(address)) => {
            let port = PeerSocket::open(address, USER)?;
            let vehicle = CrtpVehicle::new(config, now).map_err(located)?;
            fly(context, &bus, port, (vehicle, shown))
        }
        LinkSpec::Crtp(CrtpLink::Radio(_)) => {
            let reason = "an emulated Crazyflie has no radio; give --wire crtp:udp:HOST:PORT";
            Err(Failure::new(Exit::Config, reason))
        }
    }
}

/// The UDP port of an emulated vehicle.
fn udp_port(port: &PortSpec) -> Result<PeerSocket, Failure> {
    match port {
        PortSpec::UdpOut(address) => PeerSocket::connect(address, USER),
        PortSpec::UdpIn(address) => PeerSocket::open(address, USER),
        PortSpec::Serial(_) | PortSpec::Tcp(_) | PortSpec::Radio(_) => {
            let reason = "an emulated vehicle has MAVLink and MSP over UDP only; name `mavlink:udpout:HOST:PORT`, `msp:udpin:HOST:PORT` or the like in `plant.wire.link`";
            Err(Failure::new(Exit::Config, reason))
        }
    }
}

/// Runs `vehicle` at `port`; `shown` names the port in the log.
fn fly<L: LinkModel, B: OnBoardComputer>(
    context: &ProcessContext,
    bus: &Bus,
    mut port: impl VehiclePort,
    (mut vehicle, shown): (EmulatedVehicle<L, B>, String),
) -> Result<(), Failure> {
    let mut ports = TruthPorts::open(context, bus)?;
    let mut disturbances = DisturbanceClock::open(bus, &context.config)?;
    let mut outputs = Vec::with_capacity(64);
    let mut chunk = [0; CHUNK];
    tracing::info!(link = shown, "the emulated vehicle waits for a host");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        port.wait(vehicle.next_event(), vehicle.has_room(Time::now()))?;
        ports.beat()?;
        let now = Time::now();
        vehicle.disturb(disturbances.at(now)?);
        log_skipped(vehicle.skip_pause(now));
        if read_host(&mut port, &mut vehicle, (now, &mut chunk))? {
            context.health.count_input();
        }
        vehicle.advance(now, |output| outputs.push(output));
        if !outputs.is_empty() {
            context.health.count_output();
        }
        for output in outputs.drain(..) {
            if let PlantOutput::Truth(truth) = output {
                ports.publish(truth)?;
            }
        }
        while let Some(written) = vehicle.host_reads_next(now, |packet| port.write(packet)) {
            written?;
        }
        port.maintain();
    }
    log_traffic(&vehicle.counters());
    Ok(())
}

/// Passes bytes from the host to the vehicle; returns whether any arrived.
fn read_host<L: LinkModel, B: OnBoardComputer>(
    port: &mut impl VehiclePort,
    vehicle: &mut EmulatedVehicle<L, B>,
    (now, chunk): (Time, &mut [u8; CHUNK]),
) -> Result<bool, Failure> {
    for reads in 0..MAX_READS {
        let length = if vehicle.has_room(now) { port.read(chunk)? } else { 0 };
        if length == 0 {
            return Ok(reads > 0);
        }
        vehicle.host_writes(now, &chunk[..length]);
    }
    Ok(true)
}

/// Logs the traffic on the wire.
fn log_traffic(counters: &LinkCounters) {
    let LinkCounters { frames: FrameCounters { read, damaged }, up, down } = counters;
    tracing::info!(
        read,
        damaged,
        lost_up = up.lost,
        wrong_bits_up = up.wrong_bits,
        lost_down = down.lost,
        wrong_bits_down = down.wrong_bits,
        "the wire is closed"
    );
}
