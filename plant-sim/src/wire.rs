//! Emulated vehicle at the other end of a wire: the plant is flown through the bytes that a bridge sends.
//!
//! | file | subject |
//! |---|---|
//! | `pty.rs` | the pseudo-terminal, and the symbolic link to it |
//! | `radio.rs` | model of the radio: rate, latency, losses, wrong bits |
//! | `on_board.rs` | the on-board computer: commands to motors, answers |
//! | `options.rs` | `[plant.wire]` in the terms of `oqtal-wire` |
//! | `motors.rs` | the switch that starts and stops the motors |
//! | `vehicle.rs` | the emulated vehicle without its pseudo-terminal, pure |
//! | `crazyflie.rs` | an emulated Crazyflie, over UDP |
//! | `packet_air.rs` | model of a link that carries packets: latency, jitter, losses |

mod crazyflie;
mod motors;
mod on_board;
mod options;
mod packet_air;
mod pty;
mod radio;
mod vehicle;

use std::path::Path;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::faults::RadioFaults;
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::link::AsctecLink;

use crate::PlantOutput;
use crate::turn::tell_skipped;

pub use crazyflie::{CrazyflieBoard, CrtpVehicle, SupervisorModel, run_crazyflie};
pub use motors::MotorSwitch;
pub use on_board::{Measured, OnBoard};
pub use options::link;
pub use packet_air::PacketAir;
pub use pty::PseudoTerminal;
pub use radio::{LinkDirection, RadioModel, Traffic};
pub use vehicle::WiredVehicle;

/// Time between two releases of exclusive access to the terminal.
const RELEASE_PERIOD: Span = Span::from_millis(100);
/// Size of the read buffer \[bytes\].
const CHUNK: usize = 512;

/// Flies the emulated vehicle at `link` until asked to stop. Its state goes over the wire alone; the truth is published for the
/// cameras.
///
/// # Errors
/// The link cannot be made; the bus refuses or breaks.
pub fn run(context: &ProcessContext, link: &AsctecLink) -> Result<(), Failure> {
    // Joined first: a link that a killed vehicle left in the directory of the instance is gone then.
    let bus = context.bus()?;
    let terminal = PseudoTerminal::open(Path::new(&link.serial.path))?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat = heartbeat(context, &bus)?;
    let mut vehicle = WiredVehicle::new(&context.config, link, Time::now())
        .map_err(|error| context.config.locate(&error))?;
    let (mut outputs, mut answer) = (Vec::with_capacity(64), Vec::with_capacity(1024));
    let mut radio = RadioFaults::open(&bus, &context.config)?;
    let mut released_at = Time::UNSET;
    let mut chunk = [0; CHUNK];
    tracing::info!(link = link.serial.path, "the emulated vehicle waits for a host");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        terminal.wait(vehicle.next_event(), vehicle.has_room(Time::now()))?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        let read = if vehicle.has_room(now) { terminal.read(&mut chunk)? } else { 0 };
        if read > 0 {
            context.health.count_input();
        }
        vehicle.disturb_radio(radio.at(now)?);
        tell_skipped(vehicle.skip_pause(now));
        vehicle.host_writes(now, &chunk[..read]);
        vehicle.advance(now, |output| outputs.push(output));
        if !outputs.is_empty() {
            context.health.count_output();
        }
        publish_truth(&mut truths, outputs.drain(..))?;
        vehicle.host_reads(now, &mut answer);
        terminal.write(&answer)?;
        answer.clear();
        if now.since(released_at) >= RELEASE_PERIOD {
            released_at = now;
            terminal.release_exclusive();
        }
    }
    report(&vehicle);
    Ok(())
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
fn report(vehicle: &WiredVehicle) {
    let (up, down) =
        (vehicle.radio().traffic(LinkDirection::Up), vehicle.radio().traffic(LinkDirection::Down));
    let counters = vehicle.counters();
    tracing::info!(
        read = counters.frames,
        damaged = counters.damaged,
        lost_up = up.lost,
        wrong_bits_up = up.wrong_bits,
        lost_down = down.lost,
        wrong_bits_down = down.wrong_bits,
        "the wire is closed"
    );
}
