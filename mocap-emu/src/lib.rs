//! The motion-capture process: emulated cameras with noise, latency, dropouts and outliers, or playback of a recording.
//!
//! | file | subject |
//! |---|---|
//! | `body.rs` | the body whose poses are published |
//! | `cameras.rs` | emulated cameras: measurement, connection and stamp together |
//! | `pose_noise.rs`, `drift.rs` | measurement by noise on the true pose |
//! | `room.rs` | random numbers behind the effects of a real room |
//! | `markers.rs` | measurement from simulated image points of markers |
//! | `transit.rs` | frames sent, stalls, arrival |
//! | `recording.rs` | recordings: formats, parser, timing |
//! | `capture.rs` | estimated captures of a recording's poses |
//! | `statistics.rs` | statistics of a recording |
//! | `emulation.rs` | recordings made by the emulated cameras |
//! | `replay.rs` | playback of a recording |
//! | `source.rs` | emulated cameras and playback as pose sources over their ports |
//! | `serve.rs` | poses over the network, as QTM, VRPN and NatNet |
//! | `scene.rs` | bodies that move without a plant, for the command `serve` |
//!
//! [`Cameras`] and [`Replay`] are pure; [`run`] connects one of them to the bus.
#![forbid(unsafe_code)]

mod body;
mod cameras;
pub mod capture;
mod drift;
pub mod emulation;
pub mod markers;
mod pose_noise;
pub mod recording;
mod replay;
mod room;
mod scene;
mod serve;
mod source;
pub mod statistics;
mod transit;

use std::process::ExitCode;
use std::rc::Rc;

use clap::{Args, Subcommand};
use oqtal_bus::bus::Bus;
use oqtal_bus::topic::{COMMAND, Role, TRUTH};
use oqtal_config::{ClockKind, Config, FaultTarget};
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::pose_source::{PoseSource, PoseTurn};
use oqtal_runtime::process::{CommonArgs, Exit, Failure, ProcessCommand, ProcessContext, execute};
use oqtal_runtime::process_loop;
use oqtal_runtime::program::conclude;
use oqtal_runtime::turn::Turn;
use serve::{ServeArgs, ServeSpec, ServeTurn, ServedPoses};

pub use cameras::Cameras;
pub use oqtal_runtime::pose_source::Delivery;
pub use recording::{Recording, read_recording};
pub use replay::Replay;
pub use source::{EmulatedCameras, Playback, Start, is_frame};

/// Commands of the motion capture's command line.
#[derive(Subcommand, Clone, Debug)]
pub enum MocapCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(MocapArgs),
    /// Check the configuration the process would run with, and print it
    Check(MocapArgs),
    /// Serve moving bodies over the network without plant, daemon or bus, until SIGINT or SIGTERM
    Serve(ServeArgs),
}

/// Arguments of the motion capture's command line.
#[derive(Args, Clone, Debug)]
pub struct MocapArgs {
    /// Serve the poses over the network as well: qtm[:PORT],vrpn[:PORT],natnet[:PORT]
    #[arg(long, value_name = "PROTOCOLS")]
    serve: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

impl MocapCommand {
    /// Executes the command and returns its exit code.
    pub fn execute(self) -> ExitCode {
        let command = match self {
            Self::Run(args) => ProcessCommand::Run(args.common()),
            Self::Check(args) => ProcessCommand::Check(args.common()),
            Self::Serve(args) => {
                return match args.execute() {
                    Ok(exit) => exit.into(),
                    Err(failure) => conclude("oqtal mocap-emu serve", &failure),
                };
            }
        };
        execute(Role::Mocap, &command, run, check)
    }
}

impl MocapArgs {
    /// The arguments of any process; the served protocols become a setting.
    fn common(self) -> CommonArgs {
        let Self { serve, mut common } = self;
        common.settings.extend(serve.map(|text| format!("mocap.serve.protocols={text}")));
        common
    }
}

/// Checks that the cameras can run with `config`.
///
/// # Errors
/// The recording named by the configuration is invalid (exit code 65), or the served protocols are.
pub fn check(config: &Config) -> Result<(), Failure> {
    serves(config)?;
    if config.is_replay() { read_recording(&config.mocap.replay).map(drop) } else { Ok(()) }
}

/// Publishes poses of emulated cameras or of a recording. Returns when a stop is requested.
///
/// # Errors
/// The bus refuses or fails, or the recording is invalid.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let bus = Rc::new(context.bus()?);
    if context.config.is_replay() {
        let recording = read_recording(&context.config.mocap.replay)?;
        let clock = context.loop_clock(&bus, &COMMAND)?;
        // Virtual time begins once all processes have joined. In real time the first command shows that a daemon reads poses.
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

/// Whether poses are served over the network.
fn serves(config: &Config) -> Result<bool, Failure> {
    let serves = !config.mocap.serve.protocols.parse::<ServeSpec>()?.is_empty();
    if serves && config.clock.kind != ClockKind::Real {
        let reason = "mocap.serve.protocols: clients need real time; set clock.kind = \"real\"";
        return Err(Failure::new(Exit::Usage, reason));
    }
    Ok(serves)
}

fn publish_from(
    context: &ProcessContext,
    bus: &Rc<Bus>,
    (source, clock): (impl PoseSource, LoopClock),
) -> Result<(), Failure> {
    let options = &context.config.mocap.serve;
    let faulty = FaultyTransport::new(bus, &context.config)?;
    if !serves(&context.config)? {
        let turn = faulty.turn(FaultTarget::MocapEmu, PoseTurn::open(&faulty, source)?);
        return run_loop(context, bus, (turn, clock));
    }
    let bodies = [options.body.clone()];
    let (rate_hz, seed) = (context.config.mocap.rate_hz, context.config.clock.seed);
    let (feed, network) = serve::open(options, &bodies, (rate_hz, seed))?;
    for endpoint in network.endpoints() {
        tracing::info!("serving {endpoint}");
    }
    let served = ServedPoses::new(source, feed);
    std::thread::scope(|threads| {
        // Set however the loop ends, also by a panic.
        let _stop = context.stop.set_on_drop();
        threads.spawn(|| network.run(&context.stop));
        if options.publish {
            let turn = faulty.turn(FaultTarget::MocapEmu, PoseTurn::open(&faulty, served)?);
            run_loop(context, bus, (turn, clock))
        } else {
            let turn = faulty.turn(FaultTarget::MocapEmu, ServeTurn(served));
            run_loop(context, bus, (turn, clock))
        }
    })
}

fn run_loop(
    context: &ProcessContext,
    bus: &Bus,
    (mut turn, mut clock): (impl Turn, LoopClock),
) -> Result<(), Failure> {
    let mut heartbeat = context.heartbeat(bus)?;
    context.enter_realtime();
    Ok(process_loop::run(&mut turn, &mut clock, Some(&mut heartbeat))?)
}
