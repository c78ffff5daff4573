//! The controller process: guard, estimate, position loops, attitude law, limits, at the cameras' pace.
//!
//! | file | subject |
//! |---|---|
//! | `cycle.rs` | one turn of the loop |
//! | `guard.rs` | which poses are believed |
//! | `supervisor.rs` | the table of safety states |
//! | `mission.rs` | what is flown, and since when |
//! | `pilot.rs` | outer loops and attitude law |
//! | `housekeeping.rs` | logs, health, operators |
//!
//! [`Cycle`] is pure; [`run`] wires it to the bus.
#![forbid(unsafe_code)]

mod cycle;
mod guard;
mod housekeeping;
mod mission;
mod pilot;
mod supervisor;

use oqtal_bus::bus::Bus;
use oqtal_bus::config::Config;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, HealthV1, Stamps, VehicleV1};
use oqtal_bus::pace::{Pace, StopFlag};
use oqtal_bus::process::{Exit, Failure, Shell};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, POSE, Party, TELEMETRY, VEHICLE};
use oqtal_control::trajectory::{Trajectory, TrajectoryKind, Waypoints};

pub use cycle::{Cycle, Tick};
pub use guard::{Believed, Guard};
pub use housekeeping::{Condition, Desk};
pub use mission::Mission;
pub use pilot::{Decision, Pilot};
pub use supervisor::{Conditions, Supervisor};

/// Controls the vehicle until asked to stop; leaves it neutral.
///
/// # Errors
/// Another controller holds the command topic, the configuration has no meaning, or the bus refuses.
pub fn run(shell: &Shell) -> Result<(), Failure> {
    let trajectory = trajectory(&shell.config)?;
    let bus = shell.bus()?;
    let mut ports = Ports::open(&bus)?;
    let mut pace = shell.pace(&bus, &POSE)?;
    let mut cycle = Cycle::new(&shell.config, trajectory, pace.now())
        .map_err(|reason| Failure::new(Exit::Config, reason))?;
    let (mut desk, housekeeping) = housekeeping::desk(shell.config.hash());
    let place = shell.place()?;
    std::thread::scope(|threads| {
        let (ready, opened) = crossbeam_channel::bounded(1);
        let stop = &shell.stop;
        // The housekeeping thread ends with the loop, however that ends.
        let _stop = StopOnDrop(stop);
        threads.spawn(move || housekeeping.run(&place, stop, &ready));
        match opened.recv() {
            Ok(Ok(())) => {
                shell.enter_realtime();
                Ok(ports.control(&mut cycle, &mut pace, &mut desk)?)
            }
            Ok(Err(error)) => Err(error.into()),
            Err(_) => Err(Failure::new(Exit::Internal, "the housekeeping thread did not start")),
        }
    })
}

/// Asks all threads to end when it goes out of scope, be it by a panic.
struct StopOnDrop<'a>(&'a StopFlag);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.set();
    }
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

/// The daemon's ports in the loop.
struct Ports {
    poses: oqtal_bus::port::Reader<oqtal_bus::message::PoseV1>,
    vehicles: oqtal_bus::port::Reader<VehicleV1>,
    commands: oqtal_bus::port::Writer<CommandV1>,
    telemetry: oqtal_bus::port::Writer<oqtal_bus::message::TelemetryV1>,
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

    /// Controls until asked to stop or the bus breaks, and leaves the vehicle neutral either way.
    fn control(
        &mut self,
        cycle: &mut Cycle,
        pace: &mut Pace,
        desk: &mut Desk,
    ) -> Result<(), BusError> {
        let result = self.turn(cycle, pace, desk);
        self.commands.send(0, Stamps::default(), CommandV1::default())?;
        self.commands.notify()?;
        result
    }

    /// Wait, compute, publish; telemetry and the desk afterwards.
    fn turn(
        &mut self,
        cycle: &mut Cycle,
        pace: &mut Pace,
        desk: &mut Desk,
    ) -> Result<(), BusError> {
        while pace.wait(Some(cycle.next_event()))?.is_some() {
            let arrival = self.poses.latest()?;
            // After the pose was taken: nothing that is stamped later may look earlier.
            let now = pace.now();
            while let Some(verb) = desk.request() {
                desk.answer(cycle.request(now, verb));
            }
            if let Some((header, vehicle)) = self.vehicles.latest()? {
                cycle.applied(&header, &vehicle);
            }
            if let Some(tick) = cycle.step(now, arrival.as_ref()) {
                let computed_at = pace.now();
                let stamps =
                    Stamps { computed_at, command_published_at: pace.now(), ..tick.stamps };
                let sequence = self.commands.send(tick.pose_sequence, stamps, tick.command)?;
                pace.announce(&self.commands)?;
                let telemetry = cycle.report(&stamps, sequence);
                self.telemetry.send(tick.pose_sequence, stamps, telemetry)?;
                desk.note(Condition::of(&telemetry));
            }
        }
        Ok(())
    }
}

/// Says which process holds the command topic, if it tells in time: a daemon is heard twice a second.
fn name_holder(bus: &Bus, error: BusError) -> Failure {
    let held = matches!(error, BusError::Held { .. });
    let mut failure = Failure::from(error);
    if let (true, Ok(mut health)) = (held, bus.reader::<HealthV1>(&Party::Daemon.health())) {
        let give_up = Time::now() + Span::from_millis(1200);
        while Time::now() < give_up {
            if let Ok(Some((header, _))) = health.latest() {
                failure.message += &format!(" (held by process {})", header.source);
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
    failure
}
