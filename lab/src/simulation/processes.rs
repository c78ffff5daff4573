//! Turns of all processes of a flight over topics in memory, opened at the start and reopened after a kill.

use std::rc::Rc;

use oqtal_bus::code::{Answer, Cause, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::memory::{MemoryBus, MemoryWriter};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, EventV1, ReferenceV1, Stamps};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{EVENT, REFERENCE, Role};
use oqtal_bus::transport::{Publish, Transport};
use oqtal_config::FaultTarget;
use oqtal_control::position::OuterLoop;
use oqtal_control::scalar_pid::PidGains;
use oqtal_daemon::{
    CacheWarmup, Cycle, DaemonPorts, DaemonTurn, ExternalLaw, LawPort, LiveSettings, Refusal,
    loop_handoff,
};
use oqtal_mocap_emu::{Cameras, EmulatedCameras, Playback, Start};
use oqtal_plant_sim::{Plant, PlantTurn, Stepping};
use oqtal_runtime::faults::{FaultyTransport, FaultyTurn};
use oqtal_runtime::pose_source::PoseTurn;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::turn::step;
use oqtal_runtime::virtual_clock::TurnResult;

use crate::mission::Mission;

/// The ports of a process.
pub(super) type Ports = FaultyTransport<MemoryBus>;
/// The turn of a process.
pub(super) type Process<R> = FaultyTurn<MemoryBus, R>;

/// The process that publishes poses.
pub(super) enum PoseProcess {
    Cameras(Box<Process<PoseTurn<Ports, EmulatedCameras<MemoryBus>>>>),
    Playback(Box<Process<PoseTurn<Ports, Playback<MemoryBus>>>>),
}

/// The processes of a flight.
pub(super) struct Processes<'a> {
    mission: &'a Mission,
    bus: Rc<MemoryBus>,
    /// Whether an observer requires the truth of every millisecond.
    every_millisecond: bool,
    plant: Process<PlantTurn<Ports>>,
    poses: PoseProcess,
    daemon: Process<DaemonTurn<'a, Ports>>,
    settings: LiveSettings,
    events: MemoryWriter<EventV1>,
    /// Requests that changed the flight or its settings so far.
    count: u64,
}

impl<'a> Processes<'a> {
    /// Opens all processes; with `every_millisecond` the plant publishes the truth at each integration step.
    pub(super) fn open(
        mission: &'a Mission,
        bus: &Rc<MemoryBus>,
        every_millisecond: bool,
        law: LawPort<'a>,
    ) -> Result<Self, Failure> {
        let start = Time::VIRTUAL_START;
        Ok(Self {
            mission,
            bus: Rc::clone(bus),
            every_millisecond,
            plant: plant(mission, bus, start, every_millisecond)?,
            poses: PoseProcess::open(mission, bus, start)?,
            daemon: daemon(mission, bus, start, law)?,
            settings: LiveSettings::new(&mission.config, &[]),
            events: bus.writer(&EVENT)?,
            count: 0,
        })
    }

    /// Reopens the process `role` after a kill.
    pub(super) fn reopen(&mut self, role: Role, now: Time) -> Result<(), Failure> {
        let Self { mission, bus, every_millisecond, .. } = self;
        match role {
            Role::Plant => self.plant = plant(mission, bus, now, *every_millisecond)?,
            Role::Mocap => self.poses = PoseProcess::open(mission, bus, now)?,
            Role::Daemon => {
                let law = std::mem::take(&mut self.daemon.turn.law);
                self.daemon = daemon(mission, bus, now, law)?;
                self.settings = LiveSettings::new(&mission.config, &[]);
                self.count = 0;
                self.events = bus.writer(&EVENT)?;
            }
            Role::Recorder | Role::Bridge | Role::Receiver => {}
        }
        Ok(())
    }

    /// Whether the external law will not answer any more.
    pub(super) fn law_has_ended(&self) -> bool {
        self.daemon.turn.law.has_ended()
    }

    /// A writer of references, like a planner's.
    pub(super) fn references(&self) -> Result<MemoryWriter<ReferenceV1>, BusError> {
        self.bus.writer(&REFERENCE)
    }

    /// Executes a turn of `role`.
    pub(super) fn step(&mut self, role: Role, now: Time) -> Result<TurnResult, BusError> {
        match role {
            Role::Plant => step(&mut self.plant, now),
            Role::Mocap => self.poses.step(now),
            Role::Daemon => step(&mut self.daemon, now),
            // These roles do not run in virtual time.
            Role::Recorder | Role::Bridge | Role::Receiver => Ok(TurnResult::default()),
        }
    }

    /// Replaces the gains of an outer loop of the daemon.
    pub(super) fn set_loop(&mut self, which: OuterLoop, gains: PidGains) -> Result<(), Failure> {
        let set = self.daemon.turn.cycle.set_loop(which, gains);
        set.map_err(|error| Failure::new(Exit::Config, error.within("position").to_string()))
    }

    /// Makes a request that changes the flight or its settings, as the daemon's background thread does, and returns the reply.
    pub(super) fn change(
        &mut self,
        now: Time,
        command: OperatorCommand,
        request: &ControlRequestV1,
    ) -> Result<Result<ControlResponseV1, Refusal>, BusError> {
        let mut prepared = match self.settings.prepare(command, request) {
            Ok(prepared) => prepared,
            Err(refusal) => return Ok(Err(refusal)),
        };
        let is_unchanged = self.settings.are_unchanged_by(&prepared);
        self.settings.commit(&mut prepared);
        if is_unchanged {
            let answer = Answer::Done.code();
            return Ok(Ok(ControlResponseV1 { answer, ..ControlResponseV1::default() }));
        }
        self.count += 1;
        let ControlRequestV1 { point, yaw, .. } = *request;
        let event = EventV1 {
            number: self.count,
            command: command.code(),
            point,
            yaw,
            text: prepared.text,
            ..EventV1::default()
        };
        self.events.send(0, Stamps::default(), event)?;
        let named = (command, self.count);
        self.daemon.turn.change(now, named, &mut prepared.change).map(Ok)
    }

    /// Passes an operator's command to the daemon; `false` if it is refused.
    pub(super) fn request(
        &mut self,
        now: Time,
        command: OperatorCommand,
    ) -> Result<bool, BusError> {
        Ok(self.daemon.turn.request(now, command)?.answer != Answer::Refused.code())
    }
}

/// The plant of `mission`; with `every_millisecond` it publishes the truth at each integration step.
pub(super) fn plant(
    mission: &Mission,
    bus: &Rc<MemoryBus>,
    start: Time,
    every_millisecond: bool,
) -> Result<Process<PlantTurn<Ports>>, Failure> {
    let config = &mission.config;
    let faulty = FaultyTransport::new(bus, config)?;
    let plant = Plant::new(config, start);
    let plant = if every_millisecond { plant } else { plant.without_milliseconds() };
    let turn = PlantTurn::open(&faulty, plant, Stepping::Exact, config)?;
    Ok(faulty.turn(FaultTarget::PlantSim, turn))
}

fn daemon<'l>(
    mission: &Mission,
    bus: &Rc<MemoryBus>,
    start: Time,
    law: LawPort<'l>,
) -> Result<Process<DaemonTurn<'l, Ports>>, Failure> {
    let config = &mission.config;
    let faulty = FaultyTransport::new(bus, config)?;
    let cycle = Cycle::new(config, mission.trajectory.clone(), start)
        .map_err(|error| config.locate(&error))?;
    // The background side is dropped: a simulation has no requests from other threads.
    let (handle, _) = loop_handoff();
    let mut ports = DaemonPorts::open(&faulty)?;
    if config.control.is_external() {
        ports.open_exchange(&faulty)?;
    }
    ports.announce_start(start, false, Cause::None, false)?;
    let turn = DaemonTurn { ports, cycle, warmup: CacheWarmup::never(), handle, law };
    Ok(faulty.turn(FaultTarget::Daemon, turn))
}

impl PoseProcess {
    /// Executes a turn.
    pub(super) fn step(&mut self, now: Time) -> Result<TurnResult, BusError> {
        match self {
            Self::Cameras(turn) => step(turn.as_mut(), now),
            Self::Playback(turn) => step(turn.as_mut(), now),
        }
    }

    /// Opens the process of the poses of `mission`.
    pub(super) fn open(
        mission: &Mission,
        bus: &Rc<MemoryBus>,
        start: Time,
    ) -> Result<Self, Failure> {
        let config = &mission.config;
        let faulty = FaultyTransport::new(bus, config)?;
        Ok(match &mission.recording {
            Some(recording) => {
                let source = Playback::open(bus.as_ref(), recording.clone(), Start::At(start))?;
                let turn = PoseTurn::open(&faulty, source)?;
                Self::Playback(Box::new(faulty.turn(FaultTarget::MocapEmu, turn)))
            }
            None => {
                let cameras = Cameras::new(&config.mocap, config.clock.seed);
                let source = EmulatedCameras::open(bus.as_ref(), cameras)?;
                let turn = PoseTurn::open(&faulty, source)?;
                Self::Cameras(Box::new(faulty.turn(FaultTarget::MocapEmu, turn)))
            }
        })
    }
}
