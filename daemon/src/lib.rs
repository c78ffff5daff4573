//! The controller process: guard, estimate, position loops, attitude law, limits, once per pose.
//!
//! | file | subject |
//! |---|---|
//! | `cycle.rs` | the control cycle: poses and time in, command out |
//! | `cycle/intake.rs` | poses and vehicle messages in, the motion of the vehicle out |
//! | `cycle/supervision.rs` | safety state, mode and course of the flight, requests of operators |
//! | `cycle/safety.rs` | the safety conditions of a tick, its limits |
//! | `cycle/mode.rs` | the table of modes |
//! | `cycle/course.rs` | mission and reference |
//! | `cycle/requests.rs`, `cycle/first_flight.rs` | requests that wait for the next tick |
//! | `cycle/control.rs` | the command of a tick |
//! | `cycle/guarded.rs` | a law under its fallback |
//! | `cycle/report.rs` | telemetry of a tick |
//! | `command.rs` | the command in SI units, and its message |
//! | `command_model.rs` | the effect of commands on the vehicle, the tracker of its motion |
//! | `guard.rs` | the checks of a pose |
//! | `gate.rs` | the gate on the innovation: a pose against the motion predicted from the commands |
//! | `pose_rate.rs` | the rate at which poses arrive, against the expected one |
//! | `pose_noise.rs` | whether a source repeats poses |
//! | `law_guard.rs` | the selection between a law and its fallback |
//! | `envelope.rs` | the motion to which a command leads, against its limits |
//! | `external.rs` | a law outside the daemon: questions and answers |
//! | `question.rs` | the flight at a tick in which an external law is asked |
//! | `law_socket.rs` | an external law in another process |
//! | `handover.rs` | a change of the control stack without a jump of the command |
//! | `measured_noise.rs`, `delayed_mean.rs` | the noise of the poses |
//! | `consistency.rs` | consistency of the poses with the rotation, the tilt and the thrust of the vehicle |
//! | `limits.rs`, `fence.rs`, `floor.rs` | the limits of a flight |
//! | `clearance.rs` | a reference near the floor, for a vehicle below it |
//! | `descent.rs` | descent without poses of a vehicle with its own attitude loop |
//! | `room.rs` | the room of a flight under way, and the stops that stay inside |
//! | `flight_room.rs` | the path of a flight against the fence |
//! | `flyable.rs` | the demand of a flight on the vehicle |
//! | `arming.rs` | the reasons against a flight |
//! | `live.rs` | changes of a flight and of settings while the daemon runs |
//! | `refusal.rs` | a change that is refused, and its reason |
//! | `stream.rs` | references of a planner |
//! | `flight_marker.rs` | the marker that holds back the automatic take-off of the next daemon |
//! | `setpoint.rs` | the check of the reference |
//! | `loop_health.rs` | age and losses of poses, late ticks |
//! | `vehicle.rs` | monitor of the vehicle |
//! | `supervisor.rs` | the table of limits, and the safety state |
//! | `mission.rs` | the flight under way |
//! | `stack.rs` | the control stack: from motion and reference to the command |
//! | `warmup.rs` | dry-run ticks that keep the caches warm |
//! | `input_record.rs` | records of the inputs of the loop, for a replay |
//! | `turn.rs` | one turn of the process over its ports |
//! | `background.rs` | the background thread: logs, health, operator requests |
//! | `operator.rs` | operator requests, from the background thread to the loop |
//! | `condition.rs` | the condition of the loop, for logs and health |
//! | `warnings.rs` | warnings before a flight |
//! | `waypoint_file.rs` | the trajectory of a configuration |
//! | `timed_job.rs` | a job that may never end, in a thread of its own |
//!
//! [`Cycle`] is pure; [`run`] wires it to the bus.
#![forbid(unsafe_code)]

mod arming;
mod background;
mod clearance;
mod command;
mod command_model;
mod condition;
mod consistency;
mod cycle;
mod delayed_mean;
mod descent;
mod envelope;
mod external;
mod fence;
mod flight_marker;
mod flight_room;
mod floor;
mod flyable;
mod gate;
mod guard;
mod handover;
mod input_record;
mod law_guard;
mod law_socket;
mod limits;
mod live;
mod loop_health;
mod measured_noise;
mod mission;
mod operator;
mod pose_noise;
mod pose_rate;
mod question;
mod refusal;
mod room;
mod setpoint;
mod stack;
mod stream;
mod supervisor;
mod timed_job;
mod turn;
mod vehicle;
mod warmup;
mod warnings;
mod waypoint_file;

use std::os::fd::OwnedFd;
use std::rc::Rc;

use crossbeam_channel::Receiver;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::DirectPath;
use oqtal_config::{Config, FaultTarget, SafetyOptions};
use oqtal_control::trajectory::Trajectory;
use oqtal_runtime::background::with_background;
use oqtal_runtime::faults::FaultyTransport;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_runtime::process_loop;
use oqtal_runtime::turn::{Consecutive, Turn};

pub use arming::{ArmingCheck, ArmingView};
use background::DaemonWorker;
pub use command::{RotationCommand, VehicleCommand};
pub use command_model::CommandModel;
pub use condition::{Condition, Followed};
pub use cycle::{Cycle, FirstFlight, LoopTiming, Tick};
pub use envelope::{Candidate, Envelope};
pub use external::{ExternalLaw, LawPort, reason_of, without_answer};
pub use fence::Fence;
use flight_marker::TakeOffMarker;
pub use flight_room::{known_start, require_flyable};
pub use gate::MotionGate;
pub use guard::{AcceptedPose, Guard};
pub use handover::{Handover, SlewLimits};
use law_socket::SocketLaw;
pub use limits::{FlightLimits, FlightView, LimitConditions};
pub use live::{FlightChange, LiveControl, LiveSettings, PreparedChange};
pub use loop_health::LoopHealth;
pub use mission::ActiveMission;
pub use operator::{LoopHandle, LoopRequest, OperatorRequests, loop_handoff};
pub use pose_noise::PoseNoise;
pub use question::QuestionView;
pub use refusal::Refusal;
pub use setpoint::{CheckedSetpoint, SetpointGuard};
pub use stack::{ControlOutput, ControlStack, LawInput};
pub use stream::ReferenceStream;
pub use supervisor::{Ending, LIMITS, SafetyConditions, SafetyRow, Supervisor};
pub use turn::{DaemonPorts, DaemonTurn};
pub use vehicle::VehicleWatch;
pub use warmup::CacheWarmup;
pub use warnings::warnings;
pub use waypoint_file::{trajectory, trajectory_along};

/// Controls the vehicle until a stop is requested, and leaves its motors off.
///
/// # Errors
/// Another controller holds the command topic, the configuration is invalid, or the bus refuses.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let clock = |bus: &Rc<Bus>| context.loop_clock(bus, &POSE);
    run_behind(context, (), clock, None)
}

/// Like [`run`], where each turn follows one of `before` in the same loop, whose clock is `clock`; commands are also transmitted by
/// `direct`.
///
/// # Errors
/// Like [`run`].
pub fn run_behind(
    context: &ProcessContext,
    before: impl Turn,
    clock: impl FnOnce(&Rc<Bus>) -> Result<LoopClock, BusError>,
    direct: Option<Box<dyn DirectPath>>,
) -> Result<(), Failure> {
    let trajectory = fitting_trajectory(&context.config)?;
    warnings(&context.config, &trajectory).iter().for_each(|told| tracing::warn!("{told}"));
    let bus = Rc::new(context.bus()?);
    let faulty = FaultyTransport::new(&bus, &context.config)?;
    let mut ports = DaemonPorts::open(&faulty)?;
    let is_chain = direct.is_some();
    ports.transmit_by(direct);
    let mut clock = clock(&bus)?;
    let started_at = clock.now();
    let mut cycle = Cycle::new(&context.config, trajectory, started_at)
        .map_err(|error| context.config.locate(&error))?;
    let warmup =
        if clock.is_virtual() { CacheWarmup::never() } else { CacheWarmup::of(&context.config) };
    let (handle, requests) = loop_handoff();
    let (connected, connections) = law_socket::connections();
    let law = law_of(context, connections);
    if context.config.control.is_external() {
        ports.open_exchange(&faulty)?;
    }
    with_background(
        context,
        || DaemonWorker::open(context, requests, connected, is_chain),
        || {
            // Set once the ports are held: a daemon that could not start leaves no marker.
            let safety = &context.config.safety;
            let marker = TakeOffMarker::begin(bus.paths(), safety, &mut cycle, context.is_child);
            let expects_flight = context.is_child && !safety.observe_only;
            if expects_flight {
                cycle.expect_flight();
            }
            ports.announce_start(started_at, marker.stays, marker.cause, expects_flight)?;
            context.enter_realtime();
            let turn = DaemonTurn { ports, cycle, warmup, handle, law };
            let mut turn = Consecutive(before, faulty.turn(FaultTarget::Daemon, turn));
            let ended = process_loop::run(&mut turn, &mut clock, None);
            warn_in_flight(turn.1.turn.is_flying(), safety);
            marker.end(ended.is_ok(), || turn.1.turn.awaits_arm());
            ended.map_err(Into::into)
        },
    )
}

/// Warns of an end in flight.
fn warn_in_flight(is_flying: bool, safety: &SafetyOptions) {
    if is_flying && !safety.observe_only {
        tracing::warn!("the daemon ends in flight: its last command stops the motors");
    }
}

/// The external law, if `control.controller` is one: a process that arrives through `connections`.
fn law_of(context: &ProcessContext, connections: Receiver<OwnedFd>) -> LawPort<'static> {
    if context.config.control.is_external() {
        LawPort::of(SocketLaw::new(connections, context.stop.clone()))
    } else {
        LawPort::default()
    }
}

/// Whether the daemon could fly with `config`.
///
/// # Errors
/// An option of the law is invalid, or the trajectory does not fit inside the fence (exit code 78), or a waypoint file cannot
/// be read (65).
pub fn check(config: &Config) -> Result<(), Failure> {
    require_stack(config)?;
    fitting_trajectory(config).map(drop)
}

/// Whether the law and the loops of `config` can be built.
///
/// # Errors
/// An option is invalid for the law; the message names the setting at fault (exit code 78).
pub fn require_stack(config: &Config) -> Result<(), Failure> {
    let is_built = |config: &Config| ControlStack::new(config).is_ok();
    let located = |error| config.locate_change(&error, is_built).into();
    ControlStack::new(config).map(drop).map_err(located)
}

/// The trajectory of `config`, which fits inside the fence.
fn fitting_trajectory(config: &Config) -> Result<Trajectory, Failure> {
    let trajectory = trajectory(config)?;
    // A recording is only observed.
    if !config.safety.observe_only {
        require_flyable(config, &trajectory, None)?;
    }
    Ok(trajectory)
}
