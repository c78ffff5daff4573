//! The controller process: guard, estimate, position loops, attitude law, limits, at the cameras' pace.
//!
//! | file | subject |
//! |---|---|
//! | `cycle.rs` | one turn of the loop |
//! | `cycle/operator.rs` | flights that are asked for, and called off |
//! | `cycle/report.rs` | what a tick tells observers |
//! | `guard.rs` | which poses are believed |
//! | `vehicle.rs` | whether the vehicle answers |
//! | `supervisor.rs` | the table of safety states |
//! | `mission.rs` | what is flown, and since when |
//! | `pilot.rs` | outer loops and attitude law |
//! | `warmup.rs` | keeping the loop warm |
//! | `background.rs` | logs, health, operators |
//! | `marker.rs` | a daemon that did not end by itself does not take off by itself |
//!
//! [`Cycle`] is pure; [`run`] wires it to the bus.
#![forbid(unsafe_code)]

mod background;
mod cycle;
mod flight_marker;
mod guard;
mod mission;
mod pilot;
mod supervisor;
mod vehicle;
mod warmup;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, HealthV1, PoseV1, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, POSE, Role, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};

pub use background::{Condition, RtHandle};
pub use cycle::{AtStart, Cycle, Tick};
use flight_marker::FlightMarker;
pub use guard::{Accepted, Guard};
pub use mission::Mission;
pub use pilot::{ControlOutput, Pilot};
pub use supervisor::{Conditions, Supervisor};
pub use vehicle::VehicleWatch;
pub use warmup::CacheWarmup;

/// Controls the vehicle until asked to stop; leaves it neutral.
///
/// # Errors
/// Another controller holds the command topic, the configuration has no meaning, or the bus refuses.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let trajectory = trajectory(&context.config)?;
    let bus = context.bus()?;
    let ports = Ports::open(&bus)?;
    let pace = context.pace(&bus, &POSE)?;
    let mut cycle = Cycle::new(&context.config, trajectory, pace.now())
        .map_err(|reason| Failure::new(Exit::Config, reason))?;
    let warmup =
        if pace.is_virtual() { CacheWarmup::never() } else { CacheWarmup::of(&context.config) };
    let (rt_handle, background) = background::rt_handle();
    std::thread::scope(|threads| {
        let (ready, opened) = crossbeam_channel::bounded(1);
        // The background thread ends with the loop, however that ends.
        let _stop = context.stop.set_on_drop();
        threads.spawn(move || background.run(context, &ready));
        match opened.recv() {
            Ok(Ok(())) => {
                // The command topic is held: no other daemon of this instance has a marker. Whoever got no further than this
                // has not run, and leaves none.
                let marker = FlightMarker::of(bus.place());
                if context.config.safety.arm_at_start && !marker.set() {
                    cycle.stay_at_start();
                }
                context.enter_realtime();
                Loop { ports, pace, cycle, warmup, rt_handle }.control()?;
                marker.remove();
                Ok(())
            }
            Ok(Err(error)) => Err(error.into()),
            Err(_) => Err(Failure::new(Exit::Internal, "the background thread did not start")),
        }
    })
}

/// Whether the daemon could fly with `config`.
///
/// # Errors
/// An option of the law has no meaning (exit code 78), or a waypoint file cannot be read (65).
pub fn check(config: &Config) -> Result<(), Failure> {
    Pilot::new(config).map_err(|reason| Failure::new(Exit::Config, reason))?;
    trajectory(config).map(drop)
}

/// The flight that a configuration asks for.
///
/// # Errors
/// A waypoint file that cannot be read (exit code 65).
pub fn trajectory(config: &Config) -> Result<Trajectory, Failure> {
    let data = |reason: String| Failure::new(Exit::Data, reason);
    let options = &config.trajectory;
    let waypoints = match (&options.waypoints_file, options.kind) {
        (Some(file), TrajectoryKind::Waypoints) => {
            let name = file.display();
            let text =
                std::fs::read_to_string(file).map_err(|error| data(format!("{name}: {error}")))?;
            Some(Waypoints::parse(&text).map_err(|error| data(format!("{name}:{error}")))?)
        }
        _ => None,
    };
    options.trajectory(waypoints).ok_or_else(|| {
        let reason = "`trajectory.waypoints-file` must name a CSV file with columns t, x, y, z and, if wanted, yaw";
        Failure::new(Exit::Config, reason)
    })
}

/// The real-time thread's all.
struct Loop {
    ports: Ports,
    pace: LoopClock,
    cycle: Cycle,
    warmup: CacheWarmup,
    rt_handle: RtHandle,
}

impl Loop {
    /// Controls until asked to stop or the bus breaks, and leaves the vehicle neutral either way, even by a panic.
    fn control(&mut self) -> Result<(), BusError> {
        let result = catch_unwind(AssertUnwindSafe(|| self.turns()));
        self.ports.commands.send(0, Stamps::default(), CommandV1::default())?;
        self.ports.commands.notify()?;
        result.unwrap_or_else(|panic| resume_unwind(panic))
    }

    /// Wait, compute, publish; telemetry and the rt_handle afterwards.
    fn turns(&mut self) -> Result<(), BusError> {
        let Self { ports, pace, cycle, warmup, rt_handle } = self;
        while pace.wait(Some(warmup.or(cycle.next_event())))?.is_some() {
            let arrival = ports.poses.latest()?;
            // After the pose was taken: nothing that is stamped later may look earlier.
            let now = pace.now();
            if let Some((header, vehicle)) = ports.vehicles.latest()? {
                cycle.hear(now, &header, &vehicle);
            }
            if let Some(tick) = cycle.step(now, arrival.as_ref()) {
                let computed_at = pace.now();
                let stamps =
                    Stamps { computed_at, command_published_at: pace.now(), ..tick.stamps };
                let sequence = ports.commands.send(tick.pose_sequence, stamps, tick.command)?;
                pace.announce(&ports.commands)?;
                let telemetry = cycle.report(&stamps, sequence);
                ports.telemetry.send(tick.pose_sequence, stamps, telemetry)?;
                rt_handle.note(Condition::of(&telemetry, cycle.at_start()));
            } else if warmup.perform(now, cycle) {
                ports.commands.warm_up();
            }
            if let Some(arrival) = &arrival {
                warmup.expect(now, arrival);
            }
            while rt_handle.serve(|command| cycle.request(now, command)) {}
        }
        Ok(())
    }
}

/// The daemon's ports in the loop.
struct Ports {
    poses: Reader<PoseV1>,
    vehicles: Reader<VehicleV1>,
    commands: Writer<CommandV1>,
    telemetry: Writer<TelemetryV1>,
}

impl Ports {
    /// Opens them, the command topic first: it is the lock against a second controller.
    fn open(bus: &Bus) -> Result<Self, Failure> {
        let commands = bus.writer(&COMMAND).map_err(|error| name_holder(bus, error))?;
        Ok(Self {
            commands,
            poses: bus.reader(&POSE)?,
            vehicles: bus.reader(&VEHICLE)?,
            telemetry: bus.writer(&TELEMETRY)?,
        })
    }
}

/// Says which process holds the command topic, if it tells in time: a daemon is heard twice a second.
fn name_holder(bus: &Bus, error: BusError) -> Failure {
    let held = matches!(error, BusError::Held { .. });
    let mut failure = Failure::from(error);
    if let (true, Ok(mut health)) = (held, bus.reader::<HealthV1>(&Role::Daemon.health())) {
        let give_up = Time::now() + Span::from_millis(1200);
        while Time::now() < give_up {
            if let Ok(Some((header, _))) = health.latest() {
                failure.message += &format!(" (held by {})", header.origin());
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
    failure
}
