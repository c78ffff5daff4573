//! A flight in one process: the turns of the very processes, over topics in memory, in the order of the virtual clock.

pub mod online;
mod processes;

use std::rc::Rc;

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::memory::MemoryBus;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_observe::flight::Flight;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::{McapRecorder, RecordingResult};
use oqtal_observe::sink::Tee;
use oqtal_runtime::faults::outage::{Outage, TurnFaults};
use oqtal_runtime::process::{Exit, Failure, roles};
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

use crate::mission::Mission;
use processes::Processes;

/// How often a flight looks whether it is over.
pub const REVIEW: Span = Span::from_millis(250);

/// A flight under way.
struct Simulation<'a> {
    mission: &'a Mission,
    processes: Processes<'a>,
    virtual_clock: VirtualClock,
    faults: TurnFaults<MemoryBus>,
    /// The kills after which a process is to be opened anew.
    kills: Vec<Outage>,
    observer: BusObserver,
    recorder: Recorder,
    recording: Option<McapRecorder>,
    /// The present instant.
    now: Time,
    /// The instant at which the flight ends.
    end: Time,
}

/// A flight, and its recording if there is one.
pub type RecordedFlight = (Flight, Option<RecordingResult>);

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
) -> Result<RecordedFlight, Failure> {
    Simulation::new(mission, recording)?.run(Span::ZERO, &mut watch)
}

/// Flies, and records what happens for `aftermath` once the outcome is decided: whether the motors of a vehicle that has turned
/// over stop, for example.
///
/// # Errors
/// An option of the law is invalid.
pub fn fly_past_the_end(mission: &Mission, aftermath: Span) -> Result<Flight, Failure> {
    Simulation::new(mission, None)?.run(aftermath, &mut |_| None).map(|(flight, _)| flight)
}

impl<'a> Simulation<'a> {
    fn new(mission: &'a Mission, recording: Option<McapRecorder>) -> Result<Self, Failure> {
        let (config, start) = (&mission.config, Time::VIRTUAL_START);
        let bus = Rc::new(MemoryBus::new());
        let topics = match recording {
            Some(_) => McapRecorder::topics(config),
            None => Recorder::TOPICS.to_vec(),
        };
        // Open before the daemon, which records its start.
        let observer = BusObserver::open(bus.as_ref(), &topics)?;
        // A tick of the daemon has its own sample of the truth, unless a fault keeps its command from the plant.
        let every_millisecond = recording.is_some() || !config.fault.inject.is_empty();
        Ok(Self {
            mission,
            faults: TurnFaults::open(bus.as_ref(), config)?,
            kills: Vec::new(),
            processes: Processes::open(mission, &bus, start, every_millisecond)?,
            virtual_clock: VirtualClock::new(start, roles(config)),
            observer,
            recorder: Recorder::new(config),
            recording,
            now: start,
            end: start + mission.patience(),
        })
    }

    /// Flies to the end, and on for `aftermath`.
    fn run(
        mut self,
        aftermath: Span,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<RecordedFlight, Failure> {
        self.begin()?;
        let began = Time::now();
        while self.fly_to_review(aftermath, watch)? {}
        Ok(self.close(began))
    }

    /// Asks the daemon to fly.
    fn begin(&mut self) -> Result<(), BusError> {
        if self.mission.recording.is_none() {
            self.processes.obey(Time::VIRTUAL_START, OperatorCommand::Fly)?;
        }
        Ok(())
    }

    /// Flies up to the next [`REVIEW`], that included; `false` once the flight is over, and `aftermath` with it.
    fn fly_to_review(
        &mut self,
        aftermath: Span,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<bool, Failure> {
        while let Some((role, at)) = self.virtual_clock.turn() {
            self.now = at;
            let is_review = role == Role::Recorder;
            let result = if is_review {
                self.review(at, watch)?;
                if self.recorder.outcome().is_some() {
                    self.end = self.end.min(at + aftermath);
                }
                if at >= self.end {
                    return Ok(false);
                }
                TurnResult { next: Some(self.end.min(at + REVIEW)), published: false }
            } else {
                self.step(role, at)?
            };
            self.virtual_clock.done(role, result);
            if let Some(outages) = self.faults.begin()? {
                self.begin_outages(outages);
            }
            if is_review {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The flight, which was simulated since `began`.
    fn close(self, began: Time) -> RecordedFlight {
        let flown_s = self.now.since(Time::VIRTUAL_START).seconds();
        let speed = flown_s / Time::now().since(began).seconds().max(1e-9);
        let flight = self.recorder.finish(self.mission.otherwise(), speed);
        let recording = self.recording.map(|recording| recording.close(&flight));
        (flight, recording)
    }

    /// Records what was published since the last call.
    fn record(&mut self, now: Time) -> Result<(), BusError> {
        match &mut self.recording {
            Some(recording) => self.observer.poll(now, &mut Tee(&mut self.recorder, recording)),
            None => self.observer.poll(now, &mut self.recorder),
        }
    }

    fn begin_outages(&mut self, outages: Vec<Outage>) {
        self.kills = outages.iter().copied().filter(|outage| outage.is_kill).collect();
        self.virtual_clock.set_outages(outages);
    }

    fn step(&mut self, role: Role, now: Time) -> Result<TurnResult, Failure> {
        let is_over =
            |kill: &Outage| kill.role == role && kill.until.is_some_and(|until| until <= now);
        if let Some(index) = self.kills.iter().position(is_over) {
            self.kills.swap_remove(index);
            self.processes.reopen(role, now)?;
        }
        let result = self.processes.step(role, now)?;
        if role == Role::Daemon {
            // Once per tick, so that what waits for the recorder stays in the caches.
            self.record(now)?;
        }
        Ok(result)
    }

    /// Records what was published, shows the recorder to `watch`, and passes on the operator's command that it returns.
    fn review(
        &mut self,
        now: Time,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<(), Failure> {
        self.record(now)?;
        match watch(&self.recorder) {
            Some(command) if !self.processes.obey(now, command)? => {
                Err(Failure::new(Exit::Flight, "interrupted"))
            }
            _ => Ok(()),
        }
    }
}
