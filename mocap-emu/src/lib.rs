//! The motion-capture process: emulated cameras with noise, latency, dropouts and outliers, or playback of a recording.
//!
//! | file | subject |
//! |---|---|
//! | `cameras.rs` | emulated cameras |
//! | `recording.rs` | recordings: formats, parser, timing |
//! | `replay.rs` | playback of a recording |
//! | `source.rs` | both as pose sources over their ports |
//!
//! [`Cameras`] and [`Replay`] are pure; [`run`] connects one of them to the bus.
#![forbid(unsafe_code)]

mod body;
mod cameras;
pub mod recording;
mod replay;
mod source;

use std::path::Path;
use std::rc::Rc;

use oqtal_bus::bus::Bus;
use oqtal_bus::topic::{COMMAND, TRUTH};
use oqtal_config::{Config, FaultTarget};
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::pose_source::{PoseSource, PoseTurn};
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use oqtal_runtime::process_loop;

pub use cameras::Cameras;
pub use oqtal_runtime::pose_source::Delivery;
pub use recording::Recording;
pub use replay::Replay;
pub use source::{EmulatedCameras, Playback, Start, is_frame};

/// Reads the recording that a configuration names.
///
/// # Errors
/// `FILE:LINE: what is wrong`, exit code 65.
pub fn read_recording(file: &str) -> Result<Recording, Failure> {
    Recording::read(Path::new(file)).map_err(|error| Failure::new(Exit::Data, error.to_string()))
}

/// Whether the cameras could work with `config`.
///
/// # Errors
/// The recording that it names is bad (exit code 65).
pub fn check(config: &Config) -> Result<(), Failure> {
    if config.is_replay() { read_recording(&config.mocap.replay).map(drop) } else { Ok(()) }
}

/// Publishes poses until asked to stop: of emulated cameras, or of a recording.
///
/// # Errors
/// The bus refuses or breaks; the recording is bad.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let bus = Rc::new(context.bus()?);
    if context.config.is_replay() {
        let recording = read_recording(&context.config.mocap.replay)?;
        let clock = context.loop_clock(&bus, &COMMAND)?;
        // In virtual time nobody acts before everybody is there. In real time the first command shows that a daemon listens.
        let start = if clock.is_virtual() { Start::At(clock.now()) } else { Start::FirstCommand };
        context.health.set_status("playing a recording");
        publish_from(context, &bus, (Playback::open(bus.as_ref(), recording, start)?, clock))
    } else {
        let clock = context.loop_clock(&bus, &TRUTH)?;
        let cameras = Cameras::new(&context.config.mocap, context.config.clock.seed);
        let source =
            EmulatedCameras::open(bus.as_ref(), cameras)?.counted_in(context.health.clone());
        publish_from(context, &bus, (source, clock))
    }
}

fn publish_from(
    context: &ProcessContext,
    bus: &Rc<Bus>,
    (source, mut clock): (impl PoseSource, LoopClock),
) -> Result<(), Failure> {
    let mut heartbeat = context.heartbeat(bus)?;
    let faulty = FaultyTransport::new(bus, &context.config)?;
    let turn = PoseTurn::open(&faulty, source)?;
    let mut turn = faulty.turn(FaultTarget::MocapEmu, turn);
    context.enter_realtime();
    Ok(process_loop::run(&mut turn, &mut clock, Some(&mut heartbeat))?)
}
