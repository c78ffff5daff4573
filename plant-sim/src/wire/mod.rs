//! A vehicle at the other end of a wire: the plant is flown through the very bytes that a bridge sends.
//!
//! | file | subject |
//! |---|---|
//! | `line.rs` | the pseudo-terminal, and the link by which it is found |
//! | `radio.rs` | what happens to bytes on their way |
//! | `on_board.rs` | what the vehicle does about commands, and what it answers |
//! | `motors.rs` | how they are started and stopped |
//! | `vehicle.rs` | all of it but the line, as one pure object |

mod line;
mod motors;
mod on_board;
mod radio;
mod vehicle;

use std::path::Path;

use oqtal_bus::message::HealthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::link::LinkSpec;

use crate::Output;

pub use line::Line;
pub use motors::Motors;
pub use on_board::{Measured, OnBoard};
pub use radio::{Radio, Traffic, Way};
pub use vehicle::WiredVehicle;

/// How often a line is opened to a new host again.
const READMISSION: Span = Span::from_millis(100);
/// Bytes taken off the line at once.
const CHUNK: usize = 512;

/// Flies the vehicle at the end of `link` until asked to stop. What it knows of itself goes over the wire alone; the truth goes to
/// the cameras as ever.
///
/// # Errors
/// The link cannot be made; the bus refuses or breaks.
pub fn run(context: &ProcessContext, link: &LinkSpec) -> Result<(), Failure> {
    let line = Line::open(Path::new(link.path()))?;
    let bus = context.bus()?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut vehicle = WiredVehicle::new(&context.config, link, Time::now());
    let (mut outputs, mut said) = (Vec::with_capacity(64), Vec::with_capacity(1024));
    let mut readmitted_at = Time::UNSET;
    let mut chunk = [0; CHUNK];
    tracing::info!(link = link.path(), "an emulated vehicle waits for a host");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        line.wait(vehicle.next_event(), vehicle.listens(Time::now()))?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        let read = if vehicle.listens(now) { line.read(&mut chunk)? } else { 0 };
        if read > 0 {
            context.health.count_input();
        }
        vehicle.host_writes(now, &chunk[..read]);
        vehicle.advance(now, |output| outputs.push(output));
        for output in outputs.drain(..) {
            if let Output::Truth(truth) = output {
                truths.send(truth.capture, Default::default(), truth)?;
                if truth.capture > 0 {
                    truths.notify()?;
                }
            }
        }
        vehicle.host_reads(now, &mut said);
        if !said.is_empty() {
            line.write(&said)?;
            said.clear();
        }
        if now.since(readmitted_at) >= READMISSION {
            readmitted_at = now;
            line.readmit();
        }
    }
    report(&vehicle);
    Ok(())
}

/// What went over the wire, for the log.
fn report(vehicle: &WiredVehicle) {
    let (up, down) = (vehicle.radio().traffic(Way::Up), vehicle.radio().traffic(Way::Down));
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
