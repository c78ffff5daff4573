//! A lane: plant and cameras of a flight, commanded from outside in place of the daemon, one command in each control tick.
//!
//! The turns of plant and cameras, their ports, and the scheduler are those of a flight. With the commands of a flight, a lane
//! therefore has its truth and its poses, bit for bit.

use std::rc::Rc;

use oqtal_bus::error::BusError;
use oqtal_bus::memory::{MemoryBus, MemoryWriter};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, POSE, Role};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::FaultTarget;
use oqtal_daemon::LoopTiming;
use oqtal_plant_sim::{PlantTurn, State};
use oqtal_runtime::faults::{FaultyReader, FaultyTransport};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::turn::{Turn, TurnClock, step};
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

use super::processes::{Ports, PoseProcess, Process, plant};
use crate::mission::Mission;

/// Time of a command on the wire of the simulated vehicle, which has none.
const NO_WIRE: Span = Span::ZERO;
/// The processes that act in a lane; the lane's owner acts as the daemon.
const ROLES: [Role; 3] = [Role::Plant, Role::Mocap, Role::Daemon];

/// Plant and cameras at a control tick.
pub struct Lane {
    plant: Process<PlantTurn<Ports>>,
    poses: PoseProcess,
    ticks: Process<Ticks>,
    virtual_clock: VirtualClock,
    commands: MemoryWriter<CommandV1>,
    now: Time,
}

/// The part of the daemon's turn before a command: takes the pose, and decides whether a tick is due.
struct Ticks {
    arrivals: FaultyReader<MemoryBus, PoseV1>,
    timing: LoopTiming,
    /// Newest pose, and whether no tick has used it.
    pose: Option<(Header, PoseV1)>,
    is_fresh: bool,
    is_due: bool,
}

impl Turn for Ticks {
    fn next_event(&self, _now: Time) -> Option<Time> {
        Some(self.timing.next_event(self.is_fresh, NO_WIRE))
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let arrival = self.arrivals.latest()?;
        let has_arrived = arrival.is_some();
        if let Some(pose) = arrival.filter(|(_, pose)| pose.tracked != 0) {
            (self.pose, self.is_fresh) = (Some(pose), true);
        }
        self.is_due = clock.now() >= self.timing.due(has_arrived, self.is_fresh, NO_WIRE);
        Ok(())
    }
}

impl Lane {
    /// Plant and cameras of `mission` at the start of a flight, before the first tick; `start` is the state of the vehicle, by
    /// default at rest on the floor.
    ///
    /// # Errors
    /// The vehicle is not commanded by rates, or a fault is that of a process (exit code 78).
    pub fn begin(mission: &Mission, start: Option<State>) -> Result<Self, Failure> {
        let config = &mission.config;
        check(mission)?;
        let (bus, now) = (Rc::new(MemoryBus::new()), Time::VIRTUAL_START);
        let mut plant = plant(mission, &bus, now, false)?;
        plant.turn.plant().remove_gyroscope();
        if let Some(start) = start {
            let options = &config.plant;
            let share = options.mass_kg * options.gravity_m_s2 / options.max_thrust_n;
            plant.turn.plant().place(start, share.powf(options.thrust_exponent.recip()));
        }
        let faulty = FaultyTransport::new(&bus, config)?;
        let ticks = Ticks {
            arrivals: faulty.reader(&POSE)?,
            timing: LoopTiming::new(config, now),
            pose: None,
            is_fresh: false,
            is_due: false,
        };
        let mut lane = Self {
            plant,
            poses: PoseProcess::open(mission, &bus, now)?,
            ticks: faulty.turn(FaultTarget::Daemon, ticks),
            virtual_clock: VirtualClock::new(now, &ROLES),
            commands: faulty.writer(&COMMAND)?,
            now,
        };
        lane.advance()?;
        Ok(lane)
    }

    /// Publishes the command of the present tick and simulates to the next one.
    ///
    /// # Errors
    /// The transport failed.
    pub fn command(&mut self, command: CommandV1) -> Result<(), BusError> {
        let ticks = &mut self.ticks.turn;
        let header = ticks.pose.as_ref().filter(|_| ticks.is_fresh).map(|(header, _)| header);
        let stamps = header.map_or_else(Stamps::default, |header| header.stamps);
        let sequence = header.map_or(0, |header| header.pose_sequence);
        let published = Stamps { woken_at: self.now, command_published_at: self.now, ..stamps };
        ticks.timing.tick(self.now, !ticks.is_fresh);
        ticks.is_fresh = false;
        self.commands.send(sequence, published, command)?;
        let next = self.ticks.next_event(self.now);
        self.virtual_clock.done(Role::Daemon, TurnResult { next, published: true });
        self.advance()
    }

    /// Simulates to the next control tick.
    fn advance(&mut self) -> Result<(), BusError> {
        while let Some((role, at)) = self.virtual_clock.turn() {
            self.now = at;
            let result = match role {
                Role::Plant => step(&mut self.plant, at)?,
                Role::Mocap => self.poses.step(at)?,
                _ => step(&mut self.ticks, at)?,
            };
            if role == Role::Daemon && self.ticks.turn.is_due {
                // The truth at the tick: the plant integrates to this instant in its next turn in any case.
                step(&mut self.plant, at)?;
                return Ok(());
            }
            self.virtual_clock.done(role, result);
        }
        Ok(())
    }

    /// Instant of the present tick.
    pub fn now(&self) -> Time {
        self.now
    }

    /// Newest pose with its header; `None` before the first one.
    pub fn pose(&self) -> Option<&(Header, PoseV1)> {
        self.ticks.turn.pose.as_ref()
    }

    /// True state of the vehicle at the present tick.
    pub fn truth(&mut self) -> TruthV1 {
        self.plant.turn.plant().truth()
    }
}

impl std::fmt::Debug for Lane {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Lane").field("now", &self.now).finish_non_exhaustive()
    }
}

/// Refuses a mission that needs a daemon.
fn check(mission: &Mission) -> Result<(), Failure> {
    let config = &mission.config;
    let refused = |reason: &str| Err(Failure::new(Exit::Config, reason.to_owned()));
    if config.vehicle.interface != oqtal_config::Interface::Rate {
        return refused(
            "vehicle.interface: an environment commands body rates; set it to \"rate\"",
        );
    }
    if config.is_replay() {
        return refused(
            "mocap.replay: an environment has emulated cameras; leave the recording out",
        );
    }
    let is_of_process = |fault: &oqtal_config::Fault| {
        oqtal_runtime::faults::outage::role_of(fault.target).is_some()
    };
    match config.fault.inject.iter().find(|fault| is_of_process(fault)) {
        Some(fault) => refused(&format!(
            "fault {fault}: an environment has no such process; inject faults of topics"
        )),
        None => Ok(()),
    }
}
