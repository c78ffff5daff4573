//! A flight in one process: the turns of the very processes, over topics in memory, in the order of the virtual clock.

use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::memory::MemoryBus;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_daemon::{CacheWarmup, Cycle, DaemonPorts, DaemonTurn, loop_handoff};
use oqtal_mocap_emu::{Cameras, EmulatedCameras, Playback, Start};
use oqtal_observe::flight::Flight;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::{McapRecorder, RecordingResult};
use oqtal_observe::sink::Tee;
use oqtal_plant_sim::{Plant, PlantTurn, Stepping};
use oqtal_runtime::pose_source::PoseTurn;
use oqtal_runtime::process::{Exit, Failure, roles};
use oqtal_runtime::turn::step;
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

use crate::mission::Mission;

/// How often a flight looks whether it is over.
pub const REVIEW: Span = Span::from_millis(250);

/// The process that publishes poses.
enum PoseProcess {
    Cameras(Box<PoseTurn<MemoryBus, EmulatedCameras<MemoryBus>>>),
    Playback(PoseTurn<MemoryBus, Playback<MemoryBus>>),
}

/// The processes of a flight.
struct Simulation {
    plant: PlantTurn<MemoryBus>,
    poses: PoseProcess,
    daemon: DaemonTurn<MemoryBus>,
    observer: BusObserver<MemoryBus>,
    recorder: Recorder,
    recording: Option<McapRecorder>,
}

/// Flies `mission` at the speed of this thread. Depends on nothing but the mission: the same configuration and seed give the
/// same flight, bit for bit, here and over the bus.
///
/// # Errors
/// An option of the law is invalid.
pub fn fly(mission: &Mission) -> Result<Flight, Failure> {
    fly_recorded(mission, None, |_| None).map(|(flight, _)| flight)
}

/// Flies, passes every sample to `recording` if there is one, and shows the recorder to `watch` every [`REVIEW`]; `watch` may
/// return an operator's command.
///
/// # Errors
/// An option of the law is invalid, or an operator interrupted a flight that had not begun.
pub fn fly_recorded(
    mission: &Mission,
    recording: Option<McapRecorder>,
    mut watch: impl FnMut(&Recorder) -> Option<OperatorCommand>,
) -> Result<(Flight, Option<RecordingResult>), Failure> {
    let start = Time::VIRTUAL_START;
    let end = start + mission.patience();
    let mut simulation = Simulation::new(mission, start, recording)?;
    let mut virtual_clock = VirtualClock::new(start, roles(&mission.config));
    if mission.recording.is_none() {
        simulation.daemon.request(start, OperatorCommand::Fly)?;
    }
    let began = Time::now();
    let mut now = start;
    while let Some((role, at)) = virtual_clock.turn() {
        now = at;
        let result = if role == Role::Recorder {
            let command = simulation.review(now, &mut watch)?;
            if let Some(command) = command
                && !simulation.obeys(now, command)?
            {
                return Err(Failure::new(Exit::Flight, "interrupted"));
            }
            if simulation.recorder.outcome().is_some() || now >= end {
                break;
            }
            TurnResult { next: Some(end.min(now + REVIEW)), published: false }
        } else {
            simulation.step(role, now)?
        };
        virtual_clock.done(role, result);
    }
    let speed = now.since(start).seconds() / Time::now().since(began).seconds().max(1e-9);
    Ok(simulation.finish(mission, speed))
}

impl Simulation {
    fn new(
        mission: &Mission,
        start: Time,
        recording: Option<McapRecorder>,
    ) -> Result<Self, Failure> {
        let config = &mission.config;
        let bus = MemoryBus::new();
        let cycle = Cycle::new(config, mission.trajectory.clone(), start)
            .map_err(|error| config.locate(&error))?;
        // The background thread's end is dropped: nobody sends requests through it or reads notes from it.
        let (handle, _) = loop_handoff();
        let topics = match recording {
            Some(_) => McapRecorder::topics(),
            None => Recorder::TOPICS.to_vec(),
        };
        let observer = BusObserver::open(&bus, &topics)?;
        let mut ports = DaemonPorts::open(&bus)?;
        ports.announce_start(start, false)?;
        Ok(Self {
            plant: PlantTurn::open(&bus, Plant::new(config, start), Stepping::Exact, false)?,
            poses: PoseProcess::open(mission, &bus, start)?,
            daemon: DaemonTurn { ports, cycle, warmup: CacheWarmup::never(), handle },
            observer,
            recorder: Recorder::new(config),
            recording,
        })
    }

    fn step(&mut self, role: Role, now: Time) -> Result<TurnResult, BusError> {
        match role {
            Role::Plant => step(&mut self.plant, now),
            Role::Mocap => match &mut self.poses {
                PoseProcess::Cameras(turn) => step(turn.as_mut(), now),
                PoseProcess::Playback(turn) => step(turn, now),
            },
            Role::Daemon => {
                let result = step(&mut self.daemon, now)?;
                // Once per tick, so that what waits for the recorder stays in the caches.
                self.record(now)?;
                Ok(result)
            }
            // They take no part in virtual time.
            Role::Recorder | Role::Bridge => Ok(TurnResult::default()),
        }
    }

    /// Records what was published, and shows the recorder to `watch`.
    fn review(
        &mut self,
        now: Time,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<Option<OperatorCommand>, BusError> {
        self.record(now)?;
        Ok(watch(&self.recorder))
    }

    /// Records what was published since the last call.
    fn record(&mut self, now: Time) -> Result<(), BusError> {
        match &mut self.recording {
            Some(recording) => self.observer.poll(now, &mut Tee(&mut self.recorder, recording)),
            None => self.observer.poll(now, &mut self.recorder),
        }
    }

    /// Closes the records.
    fn finish(self, mission: &Mission, speed_factor: f64) -> (Flight, Option<RecordingResult>) {
        let flight = self.recorder.finish(mission.otherwise(), speed_factor);
        let recording = self.recording.map(|recording| recording.close(&flight));
        (flight, recording)
    }

    /// Passes an operator's command to the daemon; `false` if it is refused.
    fn obeys(&mut self, now: Time, command: OperatorCommand) -> Result<bool, BusError> {
        Ok(self.daemon.request(now, command)?.answer != Answer::Refused.code())
    }
}

impl PoseProcess {
    fn open(mission: &Mission, bus: &MemoryBus, start: Time) -> Result<Self, BusError> {
        Ok(match &mission.recording {
            Some(recording) => {
                let source = Playback::open(bus, recording.clone(), Start::At(start))?;
                Self::Playback(PoseTurn::open(bus, source)?)
            }
            None => {
                let config = &mission.config;
                let cameras = Cameras::new(&config.mocap, config.clock.seed);
                let source = EmulatedCameras::open(bus, cameras)?;
                Self::Cameras(Box::new(PoseTurn::open(bus, source)?))
            }
        })
    }
}
