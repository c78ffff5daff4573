//! An in-process flight: the turns of all processes over topics in memory, in the order of the virtual clock.

pub mod lane;
pub mod online;
mod processes;

use std::rc::Rc;

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::memory::MemoryBus;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_daemon::{ExternalLaw, LawPort};
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::{McapRecorder, RecordingResult};
use oqtal_observe::sink::Tee;
use oqtal_runtime::faults::outage::{Outage, TurnFaults};
use oqtal_runtime::health::SILENCE;
use oqtal_runtime::process::{Exit, Failure, roles};
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

use crate::mission::Mission;
use processes::Processes;

/// Period at which a flight checks whether it has ended.
pub const POLL_PERIOD: Span = Span::from_millis(250);

/// Flight in progress.
struct Simulation<'a> {
    mission: &'a Mission,
    processes: Processes<'a>,
    virtual_clock: VirtualClock,
    faults: TurnFaults<MemoryBus>,
    /// Kills after which a process is reopened.
    kills: Vec<Outage>,
    observer: BusObserver,
    recorder: Recorder,
    recording: Option<McapRecorder>,
    /// Present instant.
    now: Time,
    /// Last turn of the daemon.
    daemon_at: Time,
    /// Instant at which the flight ends.
    end: Time,
    /// Time between two checks of the flight.
    poll_period: Span,
}

/// A flight, with its recording if one was made.
pub type RecordedFlight = (Flight, Option<RecordingResult>);

/// Flies `mission` at the speed of this thread. The flight depends only on the mission: the same configuration and seed give the
/// same flight, bit for bit, in one process and over the bus.
///
/// # Errors
/// An option of the law is invalid.
pub fn fly(mission: &Mission) -> Result<Flight, Failure> {
    fly_recorded(mission, None, LawPort::default(), |_| None).map(|(flight, _)| flight)
}

/// Flies with `law` as the external law, passes every sample to `recording`, and calls `watch` with the recorder every [`POLL_PERIOD`]; `watch` may return an
/// operator's command.
///
/// # Errors
/// An option of the law is invalid, or an operator interrupted a flight that had not begun.
pub fn fly_recorded(
    mission: &Mission,
    recording: Option<McapRecorder>,
    law: LawPort<'_>,
    mut watch: impl FnMut(&Recorder) -> Option<OperatorCommand>,
) -> Result<RecordedFlight, Failure> {
    Simulation::new(mission, recording, law)?.run(Span::ZERO, &mut watch)
}

/// Flies `mission`, whose `control.controller` is external, with `law`. The same law, configuration and seed give the same flight.
///
/// # Errors
/// An option of the fallback law is invalid.
pub fn fly_with_law(mission: &Mission, law: &mut dyn ExternalLaw) -> Result<Flight, Failure> {
    fly_recorded(mission, None, LawPort::of(law), |_| None).map(|(flight, _)| flight)
}

/// Flies, and continues to record for `aftermath` after the outcome is decided, for example to see whether the motors of an
/// overturned vehicle stop.
///
/// # Errors
/// An option of the law is invalid.
pub fn fly_past_the_end(mission: &Mission, aftermath: Span) -> Result<Flight, Failure> {
    Simulation::new(mission, None, LawPort::default())?
        .run(aftermath, &mut |_| None)
        .map(|(flight, _)| flight)
}

impl<'a> Simulation<'a> {
    fn new(
        mission: &'a Mission,
        recording: Option<McapRecorder>,
        law: LawPort<'a>,
    ) -> Result<Self, Failure> {
        let (config, start) = (&mission.config, Time::VIRTUAL_START);
        if config.control.is_external() && law.is_none() {
            let text = "`control.controller` is external: a flight in one process has no law of another one; use `--clock lockstep` or `real`";
            return Err(Failure::new(Exit::Config, text));
        }
        let bus = Rc::new(MemoryBus::new());
        let topics = match recording {
            Some(_) => McapRecorder::topics(config),
            None => Recorder::TOPICS.to_vec(),
        };
        // Opened before the daemon, whose start is recorded.
        let observer = BusObserver::open(bus.as_ref(), &topics)?;
        // Each tick of the daemon has a truth sample, unless a fault keeps the plant from acting.
        let every_millisecond = recording.is_some() || !config.fault.inject.is_empty();
        Ok(Self {
            mission,
            faults: TurnFaults::open(bus.as_ref(), config)?,
            kills: Vec::new(),
            processes: Processes::open(mission, &bus, every_millisecond, law)?,
            virtual_clock: VirtualClock::new(start, roles(config)),
            observer,
            recorder: Recorder::new(config),
            recording,
            now: start,
            daemon_at: start,
            end: start + mission.timeout(),
            poll_period: POLL_PERIOD,
        })
    }

    /// Flies to the end, and for `aftermath` beyond it.
    fn run(
        mut self,
        aftermath: Span,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<RecordedFlight, Failure> {
        self.begin()?;
        let began = Time::now();
        while self.advance(aftermath, watch)? {}
        Ok(self.close(began))
    }

    /// Requests the flight from the daemon.
    fn begin(&mut self) -> Result<(), BusError> {
        if self.mission.recording.is_none() {
            self.processes.request(Time::VIRTUAL_START, OperatorCommand::Fly)?;
        }
        Ok(())
    }

    /// Flies until the next check; `false` once the flight and `aftermath` are over.
    fn advance(
        &mut self,
        aftermath: Span,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<bool, Failure> {
        while let Some((role, at)) = self.virtual_clock.turn() {
            self.now = at;
            let is_poll = role == Role::Recorder;
            let result = if is_poll {
                self.poll(at, watch)?;
                if self.processes.law_has_ended() {
                    self.end = self.end.min(at + self.poll_period);
                }
                if self.recorder.outcome().is_some() {
                    self.end = self.end.min(at + aftermath);
                }
                if at >= self.end {
                    return Ok(false);
                }
                TurnResult { next: Some(self.end.min(at + self.poll_period)), published: false }
            } else {
                self.step(role, at)?
            };
            self.virtual_clock.done(role, result);
            if let Some(outages) = self.faults.begin()? {
                self.begin_outages(outages);
            }
            if is_poll {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns the flight; its simulation began at `began`.
    fn close(self, began: Time) -> RecordedFlight {
        let flown_s = self.now.since(Time::VIRTUAL_START).seconds();
        let speed = flown_s / Time::now().since(began).seconds().max(1e-9);
        let is_silent = self.now.since(self.daemon_at) > SILENCE;
        let outcome = match is_silent || self.processes.law_has_ended() {
            // By an injected fault, or by an exception of the law.
            true => Outcome::Unfinished,
            false => self.mission.unfinished_outcome(),
        };
        let flight = self.recorder.finish(outcome, speed);
        let recording = self.recording.map(|recording| recording.close(&flight));
        (flight, recording)
    }

    /// Records the samples published since the last call.
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
            self.daemon_at = now;
            // Once per tick, so that waiting samples stay in the caches.
            self.record(now)?;
        }
        Ok(result)
    }

    /// Records new samples, calls `watch` with the recorder, and passes the returned operator's command to the daemon.
    fn poll(
        &mut self,
        now: Time,
        watch: &mut impl FnMut(&Recorder) -> Option<OperatorCommand>,
    ) -> Result<(), Failure> {
        self.record(now)?;
        let Some(command) = watch(&self.recorder) else { return Ok(()) };
        // A flight that is called off before the motors run has no end to wait for.
        if self.processes.request(now, command)? && self.recorder.was_armed() {
            return Ok(());
        }
        Err(Failure::new(Exit::Flight, "interrupted"))
    }
}

#[cfg(test)]
mod tests {
    use oqtal_config::{Config, Setting};

    use super::*;

    #[test]
    fn a_flight_of_a_day_ends_soon_after_it_is_stopped_at_any_poll() {
        let settings = [
            Setting::flag("test", "trajectory.kind", "hover"),
            Setting::flag("test", "trajectory.hover.duration-s", 86_400.0),
            Setting::flag("test", "plant.battery.capacity-ah", 1000.0),
        ];
        let mission = Mission::new(Config::from_settings(&settings).unwrap()).unwrap();
        for before in [0, 1, 2, 6, 12, 24] {
            let mut polls = 0;
            let watch = |_: &Recorder| {
                polls += 1;
                assert!(polls < before + 40, "stopped after {before} polls");
                (polls > before).then_some(OperatorCommand::Stop)
            };
            let _ = fly_recorded(&mission, None, LawPort::default(), watch);
        }
    }
}
