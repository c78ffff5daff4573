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
//! | `turn.rs` | one turn over the ports |
//! | `background.rs` | the background thread: logs, health, operator requests |
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
mod turn;
mod vehicle;
mod warmup;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::HealthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{POSE, Role};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::Config;
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};
use oqtal_runtime::background::with_background;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use oqtal_runtime::process_loop;

use background::DaemonWorker;
pub use background::{Condition, LoopHandle, OperatorRequests, loop_handoff};
pub use cycle::{AtStart, Cycle, Tick};
use flight_marker::FlightMarker;
pub use guard::{Accepted, Guard};
pub use mission::Mission;
pub use pilot::{ControlOutput, Pilot};
pub use supervisor::{Conditions, Supervisor};
pub use turn::{DaemonPorts, DaemonTurn};
pub use vehicle::VehicleWatch;
pub use warmup::CacheWarmup;

/// Controls the vehicle until asked to stop, and leaves its motors off.
///
/// # Errors
/// Another controller holds the command topic, the configuration is invalid, or the bus refuses.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let trajectory = trajectory(&context.config)?;
    let bus = context.bus()?;
    let ports = DaemonPorts::open(&bus).map_err(|error| name_holder(&bus, error))?;
    let mut clock = context.loop_clock(&bus, &POSE)?;
    let mut cycle = Cycle::new(&context.config, trajectory, clock.now())
        .map_err(|reason| Failure::new(Exit::Config, reason))?;
    let warmup =
        if clock.is_virtual() { CacheWarmup::never() } else { CacheWarmup::of(&context.config) };
    let (handle, requests) = loop_handoff();
    with_background(
        context,
        || DaemonWorker::open(context, requests),
        || {
            // Set once the ports are held: a daemon that could not start leaves no marker.
            let marker = FlightMarker::of(bus.paths());
            if context.config.safety.arm_at_start && !marker.set() {
                cycle.stay_at_start();
            }
            context.enter_realtime();
            process_loop::run(&mut DaemonTurn { ports, cycle, warmup, handle }, &mut clock, None)?;
            marker.remove();
            Ok(())
        },
    )
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
