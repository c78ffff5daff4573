//! The plant process: a simulated vehicle and its radio, in place of a real one.
//!
//! [`Plant`] is pure; [`run`] wires it to the bus.
#![forbid(unsafe_code)]

mod dynamics;
mod plant;
mod state;
mod world;

use oqtal_bus::config::Config;
use oqtal_bus::message::HealthV1;
use oqtal_bus::process::{Failure, Shell};
use oqtal_bus::topic::{COMMAND, TRUTH, VEHICLE};

pub use dynamics::{Disturbance, Dynamics, Input};
pub use plant::{Output, Plant};
pub use state::{Derivative, State};

/// Whether the plant could fly with `config`: any that is valid will do.
///
/// # Errors
/// None.
pub fn check(_: &Config) -> Result<(), Failure> {
    Ok(())
}

/// Flies the simulated vehicle until asked to stop.
///
/// # Errors
/// The bus refuses or breaks.
pub fn run(shell: &Shell) -> Result<(), Failure> {
    let bus = shell.bus()?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut vehicles = bus.writer(&VEHICLE)?;
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
            shell.vitals.heard();
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
                    vehicles.send(pose_sequence, stamps, vehicle)?;
                }
            }
        }
    }
}
