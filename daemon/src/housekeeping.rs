//! What must not happen on the real-time thread: logs, health, operators' requests. Fed through bounded queues that drop and
//! count rather than block.

use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, SafetyState, Verb};
use oqtal_bus::error::BusError;
use oqtal_bus::health::Pulse;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, HealthV1, TelemetryV1};
use oqtal_bus::process::Shell;

use crate::cycle::AtStart;

const QUEUE: usize = 64;
/// How often requests are looked for.
const POLL: Duration = Duration::from_millis(5);
/// How long an operator's request may wait for the next tick before it is answered with "accepted".
const PATIENCE: Duration = Duration::from_millis(60);

/// The condition of the loop, as it changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Condition {
    mode: u8,
    state: u8,
    cause: u8,
    /// Sequence of the command at which it changed.
    command_sequence: u64,
    /// Changes before it that found the queue full.
    unlogged: u64,
    at_start: AtStart,
}

impl Condition {
    /// The condition that a tick's telemetry shows, and what became of a flight at start.
    #[must_use]
    pub fn of(telemetry: &TelemetryV1, at_start: AtStart) -> Self {
        let TelemetryV1 { mode, state, cause, command_sequence, .. } = *telemetry;
        Self { mode, state, cause, command_sequence, unlogged: 0, at_start }
    }

    fn differs_from(&self, other: &Self) -> bool {
        let changing = |c: &Self| (c.mode, c.state, c.cause, c.at_start);
        changing(self) != changing(other)
    }

    /// It in words, and the state; `None` for codes that no version of ours sends.
    fn words(&self) -> Option<(String, SafetyState, Cause)> {
        let mode = Mode::from_code(self.mode)?;
        let (state, cause) = (SafetyState::from_code(self.state)?, Cause::from_code(self.cause)?);
        let words = match cause {
            Cause::None => format!("{mode}, {state}"),
            cause => format!("{mode}, {state}: {cause}"),
        };
        Some((words, state, cause))
    }
}

/// The number by which a request and its answer find each other.
type Number = u64;

/// The real-time thread's end: never blocks, never allocates.
#[derive(Debug)]
pub struct Desk {
    requests: Receiver<(Number, Verb)>,
    answers: Sender<(Number, ControlResponseV1)>,
    conditions: Sender<Condition>,
    last: Condition,
    unlogged: u64,
}

impl Desk {
    /// Answers an operator's request, if one waits, by `answer`; `false` if none does.
    pub fn serve(&self, answer: impl FnOnce(Verb) -> ControlResponseV1) -> bool {
        let Ok((number, verb)) = self.requests.try_recv() else { return false };
        // Nobody may be waiting for the answer any more.
        let _ = self.answers.try_send((number, answer(verb)));
        true
    }

    /// Tells of a change; counts those that found the queue full, and tells with the next one how many.
    pub fn note(&mut self, condition: Condition) {
        if condition.differs_from(&self.last) {
            self.last = Condition { unlogged: self.unlogged, ..condition };
            if let Err(TrySendError::Full(_)) = self.conditions.try_send(self.last) {
                self.unlogged += 1;
            }
        }
    }
}

/// The housekeeping thread's end.
#[derive(Debug)]
pub struct Housekeeping {
    requests: Sender<(Number, Verb)>,
    answers: Receiver<(Number, ControlResponseV1)>,
    conditions: Receiver<Condition>,
    asked: Number,
    last: Condition,
}

/// Both ends.
#[must_use]
pub fn desk() -> (Desk, Housekeeping) {
    let (request_in, request_out) = bounded(QUEUE);
    let (answer_in, answer_out) = bounded(QUEUE);
    let (condition_in, condition_out) = bounded(QUEUE);
    let desk = Desk {
        requests: request_out,
        answers: answer_in,
        conditions: condition_in,
        last: Condition::default(),
        unlogged: 0,
    };
    let housekeeping = Housekeeping {
        requests: request_in,
        answers: answer_out,
        conditions: condition_out,
        asked: 0,
        last: Condition::default(),
    };
    (desk, housekeeping)
}

impl Housekeeping {
    /// Keeps house until asked to stop; says through `ready` whether the ports are open.
    pub fn run(mut self, shell: &Shell, ready: &Sender<Result<(), BusError>>) {
        let opened = shell.bus().and_then(|bus: Bus| {
            let server = bus.control_server()?;
            let pulse = shell.pulse(&bus)?;
            Ok((bus, server, pulse))
        });
        let (_bus, server, mut pulse) = match opened {
            Ok(ports) => {
                let _ = ready.send(Ok(()));
                ports
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                return;
            }
        };
        while !shell.stop.is_set() {
            self.hear();
            if let Some((words, ..)) = self.last.words() {
                shell.vitals.say(words);
            }
            if let Err(error) = server.serve(|request| self.ask(request)) {
                tracing::warn!("{error}");
            }
            self.tell(&mut pulse);
            std::thread::sleep(POLL);
        }
    }

    /// Takes in what changed, and logs it.
    fn hear(&mut self) {
        while let Ok(condition) = self.conditions.try_recv() {
            log(&condition);
            if condition.at_start == AtStart::Refused && self.last.at_start != AtStart::Refused {
                tracing::warn!(
                    "no take-off at start: the vehicle is not simulated; arm with `oqtal ctl arm` when everybody is clear"
                );
            }
            self.last = condition;
        }
    }

    /// Passes a request on to the loop and waits for its answer; the loop may be standing still.
    fn ask(&mut self, request: ControlRequestV1) -> ControlResponseV1 {
        let Condition { mode, state, cause, .. } = self.last;
        let reply =
            |answer: Answer| ControlResponseV1 { answer: answer.code(), mode, state, cause };
        let Some(verb) = Verb::from_code(request.verb) else {
            return reply(Answer::Refused);
        };
        self.asked += 1;
        if self.requests.try_send((self.asked, verb)).is_err() {
            return reply(Answer::Refused);
        }
        let give_up = crossbeam_channel::after(PATIENCE);
        loop {
            crossbeam_channel::select! {
                recv(self.answers) -> answer => match answer {
                    Ok((number, response)) if number == self.asked => return response,
                    // It came too late for its own request.
                    Ok(_) => {}
                    Err(_) => return reply(Answer::Refused),
                },
                recv(give_up) -> _ => return reply(Answer::Accepted),
            }
        }
    }

    fn tell(&self, pulse: &mut Pulse) {
        let Condition { mode, state, cause, unlogged, .. } = self.last;
        if let Err(error) =
            pulse.beat(HealthV1 { state, mode, cause, unlogged, ..HealthV1::default() })
        {
            tracing::warn!("{error}");
        }
    }
}

fn log(condition: &Condition) {
    let Some((words, state, cause)) = condition.words() else { return };
    let (state_name, cause_name) = (state.to_string(), cause.to_string());
    let sequence = condition.command_sequence;
    if state == SafetyState::Nominal {
        tracing::info!(state = state_name, sequence, "{words}");
    } else {
        tracing::warn!(state = state_name, cause = cause_name, sequence, "{words}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asks(verb: Verb) -> ControlRequestV1 {
        ControlRequestV1 { verb: verb.code() }
    }

    fn answers(answer: Answer) -> ControlResponseV1 {
        ControlResponseV1 { answer: answer.code(), ..ControlResponseV1::default() }
    }

    #[test]
    fn nobody_gets_the_answer_to_the_request_of_another() {
        let (desk, mut housekeeping) = desk();
        // The loop stands still: the first operator goes without an answer of its own.
        let first = housekeeping.ask(asks(Verb::Status));
        assert_eq!(first.answer, Answer::Accepted.code());
        let second = std::thread::spawn(move || housekeeping.ask(asks(Verb::Land)));
        // The loop goes on once the second request is there, too.
        while desk.requests.len() < 2 {
            std::thread::yield_now();
        }
        assert!(desk.serve(|_| answers(Answer::Refused)));
        assert!(desk.serve(|verb| {
            assert_eq!(verb, Verb::Land);
            answers(Answer::Done)
        }));
        let second = second.join().unwrap().answer;
        // Accepted: this machine took longer for the above than an operator waits.
        assert!([Answer::Done, Answer::Accepted].map(Answer::code).contains(&second));
    }

    #[test]
    fn changes_that_found_the_queue_full_are_told_with_the_next_one() {
        let (mut desk, mut housekeeping) = desk();
        let condition = |mode| Condition { mode: u8::from(mode), ..Condition::default() };
        for number in 1..=QUEUE + 3 {
            desk.note(condition(number % 2 == 1));
        }
        housekeeping.hear();
        assert_eq!(housekeeping.last.unlogged, 0);
        desk.note(condition(QUEUE % 2 == 1));
        housekeeping.hear();
        assert_eq!(housekeeping.last.unlogged, 3);
    }
}
