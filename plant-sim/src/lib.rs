//! The plant process: a simulated vehicle and its radio, in place of a real one.
//!
//! [`Plant`] is pure; [`run`] wires it to the bus, or puts it at the other end of a radio's wire ([`wire`]).
#![forbid(unsafe_code)]

mod dynamics;
mod plant;
mod state;
pub mod wire;
mod world;

use oqtal_bus::config::Config;
use oqtal_bus::message::HealthV1;
use oqtal_bus::process::{Exit, Failure, Shell};
use oqtal_bus::topic::{COMMAND, TRUTH, VEHICLE};
use oqtal_wire::link::{InvalidLink, LinkSpec};

pub use dynamics::{Disturbance, Dynamics, Input};
pub use plant::{Output, Plant};
pub use state::{Derivative, State};

/// Whether the plant could fly with `config`.
///
/// # Errors
/// The wire's link has no meaning.
pub fn check(config: &Config) -> Result<(), Failure> {
    link(config).map(drop)
}

/// The link that the vehicle is to be found at, if its commands come over a wire.
fn link(config: &Config) -> Result<Option<LinkSpec>, Failure> {
    let text = &config.vehicle.wire.link;
    if text.is_empty() {
        return Ok(None);
    }
    let wrong =
        |error: InvalidLink| Failure::new(Exit::Config, format!("`vehicle.wire.link`: {error}"));
    text.parse().map(Some).map_err(wrong)
}

/// Flies the simulated vehicle until asked to stop.
///
/// # Errors
/// The bus refuses or breaks.
pub fn run(shell: &Shell) -> Result<(), Failure> {
    match link(&shell.config)? {
        Some(link) => wire::run(shell, &link, &oqtal_wire::asctec::Scales::default()),
        None => fly(shell),
    }
}

/// Flies by the commands on the bus.
fn fly(shell: &Shell) -> Result<(), Failure> {
    let bus = shell.bus()?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut truths = bus.writer(&TRUTH)?;
    // Of a vehicle behind the bridge it is the bridge that speaks.
    let own = !shell.config.vehicle.shadow;
    let mut vehicles = own.then(|| bus.writer(&VEHICLE)).transpose()?;
    let mut pulse = shell.pulse(&bus)?;
    let mut pace = shell.pace(&bus, &COMMAND)?;
    let mut plant = Plant::new(&shell.config, pace.now());
    let mut outputs = Vec::with_capacity(64);
    shell.enter_realtime();
    loop {
        let next = if pace.is_virtual() { plant.next_event() } else { plant.next_sample() };
        if pace.wait(Some(next))?.is_none() {
            return Ok(());
        }
        pulse.beat(HealthV1::default())?;
        let arrival = commands.latest()?;
        // After the command was taken: it must not look as if it had come before it was sent.
        let now = pace.now();
        plant.advance(now, |output| outputs.push(output));
        if let Some((header, command)) = arrival {
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
