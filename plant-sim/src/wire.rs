//! Emulated vehicle at the other end of a wire: the plant is flown through the bytes that a bridge sends.
//!
//! | file | subject |
//! |---|---|
//! | `pty.rs` | the pseudo-terminal, and the symbolic link to it |
//! | `radio.rs` | model of the radio: rate, latency, losses, wrong bits |
//! | `on_board.rs` | the on-board computer: commands to motors, answers |
//! | `options.rs` | `[plant.wire]` in the terms of `oqtal-wire` |
//! | `motors.rs` | the switch that starts and stops the motors |
//! | `crazyflie.rs` | an emulated Crazyflie, over UDP |
//! | `vehicle.rs` | AscTec's emulated vehicle without its pseudo-terminal, pure |
//! | `udp.rs` | the UDP port |
//! | `datagrams.rs` | model of the network: latency, jitter, losses |
//! | `autopilot.rs` | the emulated autopilot |
//! | `mavlink.rs` | the emulated autopilot with its network, without its port, pure |
//! | `end.rs` | what every port and every emulated vehicle does |

mod autopilot;
mod crazyflie;
mod datagrams;
mod end;
mod mavlink;
mod motors;
mod on_board;
mod options;
mod pty;
mod radio;
mod udp;
mod vehicle;

use std::path::Path;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_control::options::OptionError;
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use oqtal_wire::link::{CrtpLink, LinkSpec, PortSpec};

use crate::PlantOutput;
use crate::disturbance::DisturbanceClock;
use crate::turn::tell_skipped;

pub use autopilot::EmulatedAutopilot;
pub use crazyflie::{CrazyflieBoard, CrtpVehicle, SupervisorModel};
pub use datagrams::DatagramModel;
pub use end::{EmulatedVehicle, VehiclePort, WireCounters};
pub use mavlink::MavlinkVehicle;
pub use motors::MotorSwitch;
pub use on_board::{Measured, OnBoard};
pub use options::link;
pub use pty::PseudoTerminal;
pub use radio::{LinkDirection, RadioModel, Traffic};
pub use udp::UdpPort;
pub use vehicle::WiredVehicle;

/// Size of the read buffer \[bytes\]: more than a longest packet.
const CHUNK: usize = 2048;
/// Most reads of one turn \[-\].
const MAX_READS: usize = 16;

/// Flies the emulated vehicle at `link` until asked to stop. Its state goes over the wire alone; the truth is published for the
/// cameras.
///
/// # Errors
/// The link cannot be made; the bus refuses or breaks.
pub fn run(context: &ProcessContext, link: &LinkSpec) -> Result<(), Failure> {
    // Joined first: a link that a killed vehicle left in the directory of the instance is gone then.
    let bus = context.bus()?;
    let (config, now) = (&context.config, Time::now());
    let located = |error: OptionError| Failure::from(config.locate(&error));
    let shown = link.to_string();
    match link {
        LinkSpec::Asctec(link) => {
            let port = PseudoTerminal::open(Path::new(&link.serial.path))?;
            fly(
                context,
                &bus,
                port,
                (WiredVehicle::new(config, link, now).map_err(located)?, shown),
            )
        }
        LinkSpec::Mavlink(link) => {
            let port = udp_port(&link.port)?;
            let vehicle = MavlinkVehicle::new(config, link, now).map_err(located)?;
            fly(context, &bus, port, (vehicle, shown))
        }
        LinkSpec::Crtp(CrtpLink::Udp(address)) => {
            let port = UdpPort::at(address)?;
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
fn udp_port(port: &PortSpec) -> Result<UdpPort, Failure> {
    match port {
        PortSpec::UdpOut(address) => UdpPort::to(address),
        PortSpec::UdpIn(address) => UdpPort::at(address),
        PortSpec::Serial(_) | PortSpec::Tcp(_) | PortSpec::Radio(_) => {
            let reason = "an emulated vehicle speaks MAVLink over UDP; name `mavlink:udpout:HOST:PORT` or `udpin` in `plant.wire.link`";
            Err(Failure::new(Exit::Config, reason))
        }
    }
}

/// Flies `vehicle` at `port`, which is `shown` in the log.
fn fly(
    context: &ProcessContext,
    bus: &Bus,
    mut port: impl VehiclePort,
    (mut vehicle, shown): (impl EmulatedVehicle, String),
) -> Result<(), Failure> {
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat = heartbeat(context, bus)?;
    let mut disturbances = DisturbanceClock::open(bus, &context.config)?;
    let mut outputs = Vec::with_capacity(64);
    let mut chunk = [0; CHUNK];
    tracing::info!(link = shown, "the emulated vehicle waits for a host");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        port.wait(vehicle.next_event(), vehicle.has_room(Time::now()))?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        vehicle.disturb(disturbances.at(now)?);
        tell_skipped(vehicle.skip_pause(now));
        if !read_host(&mut port, &mut vehicle, (now, &mut chunk))? {
            context.health.count_input();
        }
        vehicle.advance(now, &mut |output| outputs.push(output));
        if !outputs.is_empty() {
            context.health.count_output();
        }
        publish_truth(&mut truths, outputs.drain(..))?;
        let mut written = Ok(());
        vehicle.host_reads(now, &mut |packet| {
            if written.is_ok() {
                written = port.write(packet);
            }
        });
        written?;
        port.maintain();
    }
    report(&vehicle.counters());
    Ok(())
}

/// Passes what the host wrote to the vehicle; returns whether that was nothing.
fn read_host(
    port: &mut impl VehiclePort,
    vehicle: &mut impl EmulatedVehicle,
    (now, chunk): (Time, &mut [u8; CHUNK]),
) -> Result<bool, Failure> {
    let mut nothing = true;
    for _ in 0..MAX_READS {
        let read = if vehicle.has_room(now) { port.read(chunk)? } else { 0 };
        if read == 0 {
            break;
        }
        nothing = false;
        vehicle.host_writes(now, &chunk[..read]);
    }
    Ok(nothing)
}

/// The heartbeat of a process that stands for a vehicle.
fn heartbeat(context: &ProcessContext, bus: &Bus) -> Result<Heartbeat, BusError> {
    Heartbeat::new(bus, context.role, HealthV1::OWN_CONFIG, context.health.clone())
}

/// Publishes every truth sample, and wakes the cameras at those that they capture.
fn publish_truth(
    truths: &mut impl Publish<TruthV1>,
    outputs: impl Iterator<Item = PlantOutput>,
) -> Result<(), BusError> {
    for output in outputs {
        if let PlantOutput::Truth(truth) = output {
            truths.send(truth.capture, Default::default(), truth)?;
            if truth.capture > 0 {
                truths.notify()?;
            }
        }
    }
    Ok(())
}

/// Logs the traffic on the wire.
fn report(counters: &WireCounters) {
    let WireCounters { read, damaged, up, down } = counters;
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
