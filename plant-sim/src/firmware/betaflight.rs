//! Plant as the body of a Betaflight that runs as a program: the firmware drives the rotors and reads the simulated sensors. It is
//! commanded over MSP, past this process; the truth is published for the cameras.

use std::net::SocketAddr;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::betaflight_sitl::{MOTORS_BYTES, read_motors, state_datagram};

use super::body::{BodyOutput, FirmwareBody, InertialSample};
use super::clock::BodyClock;
use crate::disturbance::DisturbanceClock;
use crate::socket::{self, MOST_READ, PeerSocket};
use crate::truth::TruthPorts;
use crate::turn::log_skipped;

/// Simulates the body of a Betaflight, which sends motor values to the first address and takes the state at the second. Returns when
/// a stop is requested.
///
/// # Errors
/// An address cannot be used, or the bus refuses or fails.
pub fn run(
    context: &ProcessContext,
    (motors, state): (SocketAddr, SocketAddr),
) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut ports = TruthPorts::open(context, &bus)?;
    let mut disturbances = DisturbanceClock::open(&bus, &context.config)?;
    let mut socket = PeerSocket::open(&motors, "the firmware")?;
    socket.accept(state);
    let mut body = FirmwareBody::new(&context.config, Time::now());
    let mut clock = BodyClock::new();
    tracing::info!(address = %motors, "the body waits for its firmware");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket::wait(&[&socket], clock.next_event(body.next_event()))?;
        ports.beat()?;
        let now = Time::now();
        body.disturb(disturbances.at(now)?, clock.slip());
        log_skipped(body.skip_pause(now - clock.slip()));
        let mut buffer = [0; MOTORS_BYTES + 1];
        for _ in 0..MOST_READ {
            let Some((length, _)) = socket.receive(&mut buffer)? else { break };
            if let Some(motors) = read_motors(&buffer[..length]) {
                clock.drive(now, body.time());
                body.drive(motors);
                context.health.count_input();
            }
        }
        clock.watch(now);
        let until = clock.body_time(now, body.time());
        let mut done = Ok(());
        body.advance(until, |output| {
            if done.is_ok() {
                done = pass_on(output, clock.slip(), (&socket, &mut ports));
            }
        });
        done?;
        context.health.count_output();
    }
    tracing::info!(waited_s = clock.slip().seconds(), "the body is at rest");
    Ok(())
}

/// Sends a state to the firmware, or publishes a truth that is late by `slip`.
fn pass_on(
    output: BodyOutput,
    slip: Span,
    (firmware, ports): (&PeerSocket, &mut TruthPorts),
) -> Result<(), Failure> {
    match output {
        BodyOutput::Truth(truth) => {
            Ok(ports.publish(TruthV1 { time: truth.time + slip, ..truth })?)
        }
        BodyOutput::Sensors(InertialSample { force, rate, attitude }) => {
            firmware.send(&state_datagram(rate, force, attitude))
        }
    }
}
