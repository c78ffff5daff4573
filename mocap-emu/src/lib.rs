//! The motion-capture process: six cameras as noise, latency, dropouts and outliers, or a recording with its own timing.
//!
//! [`Cameras`] and [`Replay`] are pure; [`run`] wires one of them to the bus.
#![forbid(unsafe_code)]

mod cameras;
pub mod recording;
mod replay;

use std::path::Path;

use oqtal_bus::bus::Bus;
use oqtal_bus::message::{HealthV1, PoseV1, Stamps, TruthV1};
use oqtal_bus::port::Writer;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, POSE, TRUTH};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};

pub use cameras::Cameras;
pub use recording::Recording;
pub use replay::Replay;

/// Number of the rigid body whose poses are emulated or replayed: there is one.
const BODY: u32 = 1;

/// A pose on its way to the daemon.
#[derive(Clone, Copy, Debug)]
pub struct Delivery {
    /// Number of its camera frame, from 1: a gap is a lost frame.
    pub frame: u64,
    /// Its capture.
    pub stamps: Stamps,
    /// What the cameras say.
    pub pose: PoseV1,
}

impl Delivery {
    /// The stamps with the instant of publication.
    #[must_use]
    pub fn stamps_at(&self, now: Time) -> Stamps {
        Stamps { pose_published_at: now, ..self.stamps }
    }
}

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

/// Sees the vehicle, or plays a recording, until asked to stop.
///
/// # Errors
/// The bus refuses or breaks; the recording is bad.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    if context.config.is_replay() { play(context) } else { watch(context) }
}

fn watch(context: &ProcessContext) -> Result<(), Failure> {
    let bus = context.bus()?;
    // Between two camera instants the truth comes every millisecond: none of the instants must fall out of the buffer.
    let mut truths = bus.observer(&TRUTH)?;
    let mut poses = bus.writer(&POSE)?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut pace = context.pace(&bus, &TRUTH)?;
    let mut cameras = Cameras::new(&context.config.mocap, context.config.clock.seed);
    context.enter_realtime();
    while let Some(now) = pace.wait(cameras.next_event())? {
        heartbeat.beat(HealthV1::default())?;
        while let Some((_, truth)) = truths.receive()? {
            if is_frame(&truth) {
                context.health.heard();
                cameras.capture(&truth);
            }
        }
        while let Some(delivery) = cameras.deliver(now) {
            publish(&mut poses, &mut pace, &delivery)?;
        }
    }
    Ok(())
}

fn play(context: &ProcessContext) -> Result<(), Failure> {
    let recording = read_recording(&context.config.mocap.replay)?;
    let bus: Bus = context.bus()?;
    let mut poses = bus.writer(&POSE)?;
    let mut heartbeat = context.heartbeat(&bus)?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut pace = context.pace(&bus, &COMMAND)?;
    // In virtual time nobody acts before everybody is there. In real time a daemon that commands is one that listens.
    let mut listened_to = pace.is_virtual();
    while !listened_to && pace.wait(None)?.is_some() {
        heartbeat.beat(HealthV1::default())?;
        listened_to = commands.latest()?.is_some();
    }
    let mut replay = Replay::new(recording, pace.now());
    context.health.say("playing a recording");
    context.enter_realtime();
    while let Some(now) = pace.wait(replay.next_event())? {
        heartbeat.beat(HealthV1::default())?;
        while let Some(delivery) = replay.deliver(now) {
            publish(&mut poses, &mut pace, &delivery)?;
        }
    }
    Ok(())
}

/// Whether the cameras fire at this sample of the truth.
#[must_use]
pub fn is_frame(truth: &TruthV1) -> bool {
    truth.capture > 0
}

fn publish(
    poses: &mut Writer<PoseV1>,
    pace: &mut LoopClock,
    delivery: &Delivery,
) -> Result<(), Failure> {
    poses.send(delivery.frame, delivery.stamps_at(pace.now()), delivery.pose)?;
    Ok(pace.announce(poses)?)
}
