//! What must not happen on the real-time thread: logs, health, operators' requests. Fed through bounded queues that drop and
//! count rather than block.

use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, SafetyState, Verb};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, HealthV1, Stamps, TelemetryV1};
use oqtal_bus::pace::StopFlag;
use oqtal_bus::place::Place;
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Party;

const QUEUE: usize = 64;
/// How often requests are looked for.
const POLL: Duration = Duration::from_millis(5);
/// How long an operator's request may wait for the next tick before it is answered with "accepted".
const PATIENCE: Duration = Duration::from_millis(60);
const HEALTH_PERIOD: Span = Span::from_millis(500);

/// The condition of the loop, as it changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Condition {
    mode: u8,
    state: u8,
    cause: u8,
    /// Sequence of the command at which it changed.
    command_sequence: u64,
}

impl Condition {
    /// The condition that a tick's telemetry shows.
    #[must_use]
    pub fn of(telemetry: &TelemetryV1) -> Self {
        let TelemetryV1 { mode, state, cause, command_sequence, .. } = *telemetry;
        Self { mode, state, cause, command_sequence }
    }

    fn differs_from(&self, other: &Self) -> bool {
        (self.mode, self.state, self.cause) != (other.mode, other.state, other.cause)
    }
}

/// The real-time thread's end: never blocks, never allocates.
#[derive(Debug)]
pub struct Desk {
    requests: Receiver<Verb>,
    answers: Sender<ControlResponseV1>,
    conditions: Sender<Condition>,
    last: Condition,
    dropped: u64,
}

impl Desk {
    /// An operator's request, if one waits.
    #[must_use]
    pub fn request(&self) -> Option<Verb> {
        self.requests.try_recv().ok()
    }

    /// Answers the request just taken. Nobody may be waiting for it any more.
    pub fn answer(&self, response: ControlResponseV1) {
        let _ = self.answers.try_send(response);
    }

    /// Tells of a change; counts those that found the queue full.
    pub fn note(&mut self, condition: Condition) {
        if condition.differs_from(&self.last) {
            self.last = condition;
            if let Err(TrySendError::Full(_)) = self.conditions.try_send(condition) {
                self.dropped += 1;
            }
        }
    }

    /// Changes nobody heard of.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// The housekeeping thread's end.
#[derive(Debug)]
pub struct Housekeeping {
    requests: Sender<Verb>,
    answers: Receiver<ControlResponseV1>,
    conditions: Receiver<Condition>,
    config_hash: u64,
    last: Condition,
}

/// Both ends, for a daemon whose configuration has this hash.
#[must_use]
pub fn desk(config_hash: u64) -> (Desk, Housekeeping) {
    let (request_in, request_out) = bounded(QUEUE);
    let (answer_in, answer_out) = bounded(QUEUE);
    let (condition_in, condition_out) = bounded(QUEUE);
    let desk = Desk {
        requests: request_out,
        answers: answer_in,
        conditions: condition_in,
        last: Condition::default(),
        dropped: 0,
    };
    let housekeeping = Housekeeping {
        requests: request_in,
        answers: answer_out,
        conditions: condition_out,
        config_hash,
        last: Condition::default(),
    };
    (desk, housekeeping)
}

impl Housekeeping {
    /// Keeps house until asked to stop; says through `ready` whether the ports are open.
    pub fn run(mut self, place: &Place, stop: &StopFlag, ready: &Sender<Result<(), BusError>>) {
        let opened = Bus::open(place).and_then(|bus| {
            let server = bus.control_server()?;
            let health = bus.writer(&Party::Daemon.health())?;
            Ok((bus, server, health))
        });
        let (_bus, server, mut health) = match opened {
            Ok(ports) => {
                let _ = ready.send(Ok(()));
                ports
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                return;
            }
        };
        let mut next_health = Time::now();
        while !stop.is_set() {
            let changed = self.hear();
            if let Err(error) = server.serve(|request| self.ask(request)) {
                tracing::warn!("{error}");
            }
            if changed || Time::now() >= next_health {
                next_health = Time::now() + HEALTH_PERIOD;
                self.tell(&mut health);
            }
            std::thread::sleep(POLL);
        }
    }

    /// Takes in what changed, and logs it.
    fn hear(&mut self) -> bool {
        let mut changed = false;
        while let Ok(condition) = self.conditions.try_recv() {
            changed = true;
            let (mode, state) =
                (Mode::from_code(condition.mode), SafetyState::from_code(condition.state));
            if let (Some(mode), Some(state), Some(cause)) =
                (mode, state, Cause::from_code(condition.cause))
            {
                log(mode, state, cause, condition.command_sequence);
            }
            self.last = condition;
        }
        changed
    }

    /// Passes a request on to the loop and waits for its answer; the loop may be standing still.
    fn ask(&self, request: ControlRequestV1) -> ControlResponseV1 {
        let Condition { mode, state, cause, .. } = self.last;
        let reply =
            |answer: Answer| ControlResponseV1 { answer: answer.code(), mode, state, cause };
        let Some(verb) = Verb::from_code(request.verb) else {
            return reply(Answer::Refused);
        };
        // An answer that came too late for its request must not be taken for this one's.
        while self.answers.try_recv().is_ok() {}
        if self.requests.try_send(verb).is_err() {
            return reply(Answer::Refused);
        }
        self.answers.recv_timeout(PATIENCE).unwrap_or_else(|_| reply(Answer::Accepted))
    }

    fn tell(&self, health: &mut Writer<HealthV1>) {
        let Condition { mode, state, cause, .. } = self.last;
        let body = HealthV1 { config_hash: self.config_hash, state, mode, cause };
        if let Err(error) = health.send(0, Stamps::default(), body) {
            tracing::warn!("{error}");
        }
    }
}

fn log(mode: Mode, state: SafetyState, cause: Cause, sequence: u64) {
    let (mode_name, state_name, cause_name) =
        (mode.to_string(), state.to_string(), cause.to_string());
    if state == SafetyState::Nominal {
        tracing::info!(state = state_name, sequence, "{mode_name}");
    } else {
        tracing::warn!(state = state_name, cause = cause_name, sequence, "{mode_name}");
    }
}
