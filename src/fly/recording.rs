//! Recording of a flight through processes: requests the flight, and polls the observer until the flight has ended.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, ControlHolder, Mode, OperatorCommand};
use oqtal_bus::control::ControlClient;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Role};
use oqtal_config::ClockKind;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::{self, RecordedFlight};
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::flight_sample::FlightSample;
use oqtal_observe::kernel::ProcessUsage;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::{Facts, McapRecorder};
use oqtal_observe::sink::Tee;
use oqtal_observe::status::word;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;

use super::process_group::START_TIMEOUT;
use super::progress::FlightProgress;
use super::vehicle::CommandLink;

/// Polling period in real time: the resolution of the reception times.
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// Time-out for the landing of a flight that lasted too long; the daemon stops a landing that does not end (F41).
const LANDED_WITHIN: Span = Span::from_millis(60_000);
/// Ticks after which a daemon that has accepted the flight no longer shows a mode from before \[-\].
const STARTED_TICKS: usize = 30;
/// Time for which motors must be reported off before they count as stopped: slightly more than a bridge waits for a late report.
const MOTORS_SETTLE: Span = Span::from_millis(600);
/// Time for which the recording continues after an operator's stop: the stop takes effect before the daemon receives the request
/// that names its author.
const STOP_REQUESTED_WITHIN: Span = Span::from_millis(500);

/// Inputs of a recording.
#[derive(Debug)]
pub struct FlightRecording<'a> {
    /// The mission.
    pub mission: &'a Mission,
    /// Path of the commands to the vehicle.
    pub link: &'a CommandLink,
    /// The instance of the flight.
    pub bus: &'a Bus,
    /// Ends the recording when set.
    pub stop: &'a StopFlag,
}

/// The state of a recording.
struct Progressing {
    recorder: Recorder,
    recording: Option<McapRecorder>,
    daemon: Option<ProcessUsage>,
    /// Start of the recording in wall time.
    wall: Time,
    /// First poll that counts, in the clock of the flight and in wall time.
    first: Option<(Time, Time)>,
    /// The latest poll, in the clock of the flight.
    now: Time,
    /// End of the flight, and last instant after it at which the motors were reported running, in wall time.
    over_since: Option<Time>,
    running_at: Option<Time>,
    /// Last poll at which the flight had no planned end, in the clock of the flight.
    open_at: Option<Time>,
    /// Instant at which an overlong flight was requested to land, in wall time.
    landing_since: Option<Time>,
}

impl FlightRecording<'_> {
    /// Requests the flight from the daemon and records until it has ended, or `stop` is set.
    ///
    /// # Errors
    /// The daemon refuses or does not answer, the vehicle does not answer, or the bus failed.
    pub fn run(
        &self,
        mut observer: BusObserver,
        recording: Option<McapRecorder>,
    ) -> Result<RecordedFlight, Failure> {
        if !self.only_observes() {
            request_flight(&self.bus.control_client()?, self.mission.config.hash(), self.stop)?;
        }
        let progress = FlightProgress::new(self.mission);
        let mut clock = ReviewClock::new(self.mission, self.bus, self.stop)?;
        let mut state = Progressing {
            recorder: Recorder::new(&self.mission.config),
            recording,
            daemon: None,
            wall: Time::now(),
            first: None,
            now: Time::UNSET,
            over_since: None,
            running_at: None,
            open_at: None,
            landing_since: None,
        };
        let mut is_over = false;
        while !is_over && let Some(now) = clock.next_poll()? {
            state.now = now;
            state.poll(&mut observer)?;
            progress.show(&state.recorder);
            is_over = self.check(&mut state, clock.is_virtual())?;
        }
        progress.finish();
        // A flight is cut off by an interrupt before the take-off, and by the end of a process.
        let unfinished =
            if is_over { self.mission.unfinished_outcome() } else { Outcome::Unfinished };
        Ok(self.conclude(state, unfinished))
    }

    /// Checks the flight after new samples were recorded; `true` if it has ended.
    fn check(&self, state: &mut Progressing, is_virtual: bool) -> Result<bool, Failure> {
        let recorder = &state.recorder;
        if state.daemon.is_none() {
            state.daemon = recorder.daemon_pid().and_then(ProcessUsage::of);
            if let (Some(daemon), Some(recording)) = (&state.daemon, &mut state.recording) {
                recording.facts(Facts::of_grants(&daemon.realtime));
            }
        }
        // The flight of a recording starts with its first pose, at whatever time the daemon started.
        let started = match self.mission.recording {
            Some(_) => recorder.has_poses(),
            None => recorder.daemon_pid().is_some(),
        };
        if started || is_virtual {
            state.first.get_or_insert((state.now, Time::now()));
        } else if state.first.is_none() && Time::now().since(state.wall) > START_TIMEOUT {
            return Err(never_started(&self.mission.config.instance.name));
        }
        let flown = state.first.map_or(Span::ZERO, |(began, _)| state.now.since(began));
        let timeout = self.link.answer_timeout(&self.mission.config);
        if !recorder.wire().answered() && timeout.is_some_and(|timeout| flown >= timeout) {
            return Err(self.link.never_answered(&self.mission.config.plant.truth));
        }
        if self.mission.recording.is_none() && has_lost_request(recorder) {
            return Err(called_off(
                "an operator asked to land, disarm or stop, or the vehicle or the daemon was replaced",
            ));
        }
        // A flight that an operator changes has no planned end; a replay has none either, and ends with its recording.
        let is_open = self.mission.recording.is_none()
            && recorder.latest().is_some_and(|s| s.telemetry.planned_landing_s.is_infinite());
        if is_open {
            state.open_at = Some(state.now);
        }
        // After the last change of an operator's flight, the landing and its outcome need some time.
        let has_planned_end = state.open_at.is_none_or(|at| state.now.since(at) >= LANDED_WITHIN);
        let is_late = has_planned_end && flown >= self.mission.timeout();
        let is_over = state.recorder.outcome().is_some()
            || is_late && (is_virtual || self.has_landed_late(state)?);
        Ok(is_over && self.motors_rest(state) && !state.awaits_stop_request())
    }

    /// Whether nothing is flown.
    fn only_observes(&self) -> bool {
        self.mission.recording.is_some() || self.mission.config.safety.observe_only
    }

    /// Lands a vehicle that flies longer than allowed, since ending the processes would make it fall. Returns whether the wait is
    /// over.
    fn has_landed_late(&self, state: &mut Progressing) -> Result<bool, Failure> {
        if self.only_observes() || !state.recorder.latest().is_some_and(FlightSample::is_armed) {
            return Ok(true);
        }
        if state.landing_since.is_none() && !self.stop.is_set() {
            say("oqtal: the flight has lasted too long: landing");
            let land = ControlRequestV1::of(OperatorCommand::Land).by("oqtal fly");
            self.bus.control_client()?.ask(land, Span::from_millis(500))?;
        }
        let since = *state.landing_since.get_or_insert_with(Time::now);
        Ok(Time::now().since(since) >= LANDED_WITHIN)
    }

    /// Whether the motors behind a bridge are off, or controlled by another station, or the time-out has passed. A bridge stops
    /// the motors once the vehicle has rested; before that, it can only use the emergency stop.
    fn motors_rest(&self, state: &mut Progressing) -> bool {
        let now = Time::now();
        let since = *state.over_since.get_or_insert(now);
        let runs = |vehicle: &VehicleV1| {
            vehicle.armed == 1 && vehicle.control != ControlHolder::Another.code()
        };
        if state.recorder.wire().latest().is_some_and(runs) {
            state.running_at = Some(now);
        }
        let timeout = self.link.rest_timeout(&self.mission.config);
        state.running_at.is_none_or(|at| now.since(at) >= MOTORS_SETTLE)
            || now.since(since) >= timeout
    }

    /// Reports losses and closes the record; a flight without a landing or crash has the outcome `unfinished`.
    fn conclude(&self, state: Progressing, unfinished: Outcome) -> RecordedFlight {
        let Progressing { recorder, recording, mut daemon, first, now, landing_since, .. } = state;
        // Lost health messages are not reported: only the newest one is used.
        let is_needed = |topic: &ObservedTopic| !matches!(topic, ObservedTopic::Health(_));
        for (topic, lost) in recorder.lost().iter().filter(|(topic, _)| is_needed(topic)) {
            say(&format!(
                "oqtal: {lost} samples of `{topic}` were not recorded: this machine is overloaded, or `oqtal fly` was stopped"
            ));
        }
        let speed_factor = first.map_or(0.0, |(began, wall)| {
            now.since(began).seconds() / Time::now().since(wall).seconds().max(1e-9)
        });
        if let (Some(daemon), Some(pid)) = (&mut daemon, recorder.daemon_pid()) {
            daemon.update(pid);
        }
        let command_path = self.link.command_path();
        let flight = recorder.finish(unfinished, speed_factor);
        let outcome = match flight.outcome {
            Outcome::Landed if landing_since.is_some() => Outcome::Timeout,
            outcome => outcome,
        };
        let flight = Flight { daemon, command_path, outcome, ..flight };
        let recording = recording.map(|recording| recording.close(&flight));
        (flight, recording)
    }
}

impl Progressing {
    /// Whether the request of the operator who stopped the flight may not have been published yet.
    fn awaits_stop_request(&self) -> bool {
        let is_requested = |sample: &FlightSample| sample.telemetry.cause == Cause::Operator.code();
        self.recorder.outcome() == Some(Outcome::Stopped)
            && self.recorder.latest().is_some_and(is_requested)
            && self.over_since.is_some_and(|at| Time::now().since(at) < STOP_REQUESTED_WITHIN)
    }

    /// Records the samples published since the last call.
    fn poll(&mut self, observer: &mut BusObserver) -> Result<(), BusError> {
        let Some(recording) = &mut self.recording else {
            return observer.poll(self.now, &mut self.recorder);
        };
        recording.note_clock(self.now);
        observer.poll(self.now, &mut Tee(&mut self.recorder, recording))
    }
}

/// Clock of the recorder: a poll every few milliseconds, or a turn in virtual time.
enum ReviewClock {
    Real(StopFlag),
    Virtual { clock: Box<LoopClock>, next: Option<Time>, end: Time },
}

impl ReviewClock {
    fn new(mission: &Mission, bus: &Bus, stop: &StopFlag) -> Result<Self, Failure> {
        Ok(match mission.config.clock.kind {
            ClockKind::Real => Self::Real(stop.clone()),
            ClockKind::Lockstep | ClockKind::InProcess => Self::Virtual {
                clock: Box::new(LoopClock::follower(bus, Role::Recorder, stop.clone())?),
                next: None,
                end: Time::VIRTUAL_START + mission.timeout(),
            },
        })
    }

    /// Waits for the next poll; `None` if a stop was requested.
    fn next_poll(&mut self) -> Result<Option<Time>, Failure> {
        match self {
            Self::Real(stop) => {
                std::thread::sleep(POLL_PERIOD);
                Ok((!stop.is_set()).then(Time::now))
            }
            Self::Virtual { clock, next, end } => {
                let now = clock.wait(*next)?;
                *next = now.map(|now| (now + simulation::POLL_PERIOD).min(*end));
                Ok(now)
            }
        }
    }

    fn is_virtual(&self) -> bool {
        matches!(self, Self::Virtual { .. })
    }
}

/// Requests the flight from the daemon until it answers.
fn request_flight(
    client: &ControlClient,
    config_hash: u64,
    stop: &StopFlag,
) -> Result<(), Failure> {
    let deadline = Time::now() + START_TIMEOUT;
    let fly = ControlRequestV1::of(OperatorCommand::Fly).by("oqtal fly");
    let request = ControlRequestV1 { valid_until: deadline, config_hash, ..fly };
    while Time::now() < deadline && !stop.is_set() {
        match client.ask(request, Span::from_millis(200))? {
            Some(response) if response.answer == Answer::Refused.code() => {
                return Err(match Cause::from_code(response.cause) {
                    Some(Cause::Operator | Cause::CalledOff) => {
                        called_off("an operator asked to land, disarm or stop")
                    }
                    cause => {
                        let message = format!("the daemon refuses to fly: {}", word(cause));
                        Failure::new(Exit::Flight, message)
                    }
                });
            }
            Some(_) => return Ok(()),
            None => {}
        }
    }
    if stop.is_set() {
        // The watch that set the flag reports the reason.
        return Ok(());
    }
    Err(Failure::new(Exit::Peer, "the daemon never answered; see its log beside the report"))
}

/// Whether the daemon is disarmed again although the requested flight has not begun.
fn has_lost_request(recorder: &Recorder) -> bool {
    let is_disarmed = |sample: &FlightSample| sample.telemetry.mode == Mode::Disarmed.code();
    recorder.outcome().is_none()
        && !recorder.was_armed()
        && recorder.samples().len() >= STARTED_TICKS
        && recorder.latest().is_some_and(is_disarmed)
}

/// Failure of a flight that was called off.
fn called_off(reason: &str) -> Failure {
    let message = format!("the flight was called off before the take-off: {reason}");
    Failure::new(Exit::Flight, message)
}

fn never_started(instance: &str) -> Failure {
    let message = format!(
        "no sample of the daemon arrived on instance `{instance}`; see the log of the daemon beside the report"
    );
    Failure::new(Exit::Peer, message)
}
