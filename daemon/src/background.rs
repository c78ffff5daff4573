//! What must not happen on the real-time thread: logs, health, operators' requests. Fed through bounded queues that drop and
//! count rather than block.

use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, HealthV1, TelemetryV1};
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::ProcessContext;

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
pub struct RtHandle {
    requests: Receiver<(Number, OperatorCommand)>,
    answers: Sender<(Number, ControlResponseV1)>,
    conditions: Sender<Condition>,
    last: Condition,
    unlogged: u64,
}

impl RtHandle {
    /// Answers an operator's request, if one waits, by `answer`; `false` if none does.
    pub fn serve(&self, answer: impl FnOnce(OperatorCommand) -> ControlResponseV1) -> bool {
        let Ok((number, command)) = self.requests.try_recv() else { return false };
        // Nobody may be waiting for the answer any more.
        let _ = self.answers.try_send((number, answer(command)));
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

/// The background thread's end.
#[derive(Debug)]
pub struct BackgroundWorker {
    requests: Sender<(Number, OperatorCommand)>,
    answers: Receiver<(Number, ControlResponseV1)>,
    conditions: Receiver<Condition>,
    asked: Number,
    last: Condition,
}

/// Both ends.
#[must_use]
pub fn rt_handle() -> (RtHandle, BackgroundWorker) {
    let (request_in, request_out) = bounded(QUEUE);
    let (answer_in, answer_out) = bounded(QUEUE);
    let (condition_in, condition_out) = bounded(QUEUE);
    let rt_handle = RtHandle {
        requests: request_out,
        answers: answer_in,
        conditions: condition_in,
        last: Condition::default(),
        unlogged: 0,
    };
    let background = BackgroundWorker {
        requests: request_in,
        answers: answer_out,
        conditions: condition_out,
        asked: 0,
        last: Condition::default(),
    };
    (rt_handle, background)
}

impl BackgroundWorker {
    /// Keeps house until asked to stop; says through `ready` whether the ports are open.
    pub fn run(mut self, context: &ProcessContext, ready: &Sender<Result<(), BusError>>) {
        let opened = context.bus().and_then(|bus: Bus| {
            let server = bus.control_server()?;
            let heartbeat = context.heartbeat(&bus)?;
            Ok((bus, server, heartbeat))
        });
        let (_bus, server, mut heartbeat) = match opened {
            Ok(ports) => {
                let _ = ready.send(Ok(()));
                ports
            }
            Err(error) => {
                let _ = ready.send(Err(error));
                return;
            }
        };
        while !context.stop.is_set() {
            self.hear();
            if let Some((words, ..)) = self.last.words() {
                context.health.say(words);
            }
            if let Err(error) = server.serve(|request| self.ask(request)) {
                tracing::warn!("{error}");
            }
            self.tell(&mut heartbeat);
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
        let Some(command) = OperatorCommand::from_code(request.command) else {
            return reply(Answer::Refused);
        };
        self.asked += 1;
        if self.requests.try_send((self.asked, command)).is_err() {
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

    fn tell(&self, heartbeat: &mut Heartbeat) {
        let Condition { mode, state, cause, unlogged, .. } = self.last;
        if let Err(error) =
            heartbeat.beat(HealthV1 { state, mode, cause, unlogged, ..HealthV1::default() })
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

    fn asks(command: OperatorCommand) -> ControlRequestV1 {
        ControlRequestV1 { command: command.code() }
    }

    fn answers(answer: Answer) -> ControlResponseV1 {
        ControlResponseV1 { answer: answer.code(), ..ControlResponseV1::default() }
    }

    #[test]
    fn nobody_gets_the_answer_to_the_request_of_another() {
        let (rt_handle, mut background) = rt_handle();
        // The loop stands still: the first operator goes without an answer of its own.
        let first = background.ask(asks(OperatorCommand::Status));
        assert_eq!(first.answer, Answer::Accepted.code());
        let second = std::thread::spawn(move || background.ask(asks(OperatorCommand::Land)));
        // The loop goes on once the second request is there, too.
        while rt_handle.requests.len() < 2 {
            std::thread::yield_now();
        }
        assert!(rt_handle.serve(|_| answers(Answer::Refused)));
        assert!(rt_handle.serve(|command| {
            assert_eq!(command, OperatorCommand::Land);
            answers(Answer::Done)
        }));
        let second = second.join().unwrap().answer;
        // Accepted: this machine took longer for the above than an operator waits.
        assert!([Answer::Done, Answer::Accepted].map(Answer::code).contains(&second));
    }

    #[test]
    fn changes_that_found_the_queue_full_are_told_with_the_next_one() {
        let (mut rt_handle, mut background) = rt_handle();
        let condition = |mode| Condition { mode: u8::from(mode), ..Condition::default() };
        for number in 1..=QUEUE + 3 {
            rt_handle.note(condition(number % 2 == 1));
        }
        background.hear();
        assert_eq!(background.last.unlogged, 0);
        rt_handle.note(condition(QUEUE % 2 == 1));
        background.hear();
        assert_eq!(background.last.unlogged, 3);
    }
}
