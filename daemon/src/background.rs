//! The background thread of the daemon: logs, health, operator requests.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam_channel::Sender;
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, OperatorCommand, SafetyState};
use oqtal_bus::control::ControlServer;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, HealthV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle, handoff};
use oqtal_runtime::health::{Health, Heartbeat};
use oqtal_runtime::process::{Failure, ProcessContext};

use crate::condition::Condition;
use crate::cycle::AutoTakeoff;
use crate::law_socket::LawListener;

/// An operator's request that the loop has not answered by then is answered with "accepted".
const REPLY_TIMEOUT: Duration = Duration::from_millis(60);

/// Number by which a request and its reply find each other.
type RequestNumber = u64;
type NumberedRequest = (RequestNumber, OperatorCommand, ValidUntil);
/// Instant after which a request must not begin a flight; unset for no limit.
type ValidUntil = Time;
type NumberedReply = (RequestNumber, ControlResponseV1);

/// The real-time thread's end of the hand-off.
#[derive(Debug)]
pub struct LoopHandle {
    queues: RtHandle<Condition, NumberedRequest, NumberedReply>,
    configs_differ: Arc<AtomicBool>,
    last: Condition,
}

/// The background thread's end of the hand-off.
#[derive(Debug)]
pub struct OperatorRequests {
    queues: BackgroundHandle<Condition, NumberedRequest, NumberedReply>,
    configs_differ: Arc<AtomicBool>,
    count: RequestNumber,
    last: Condition,
    config_hash: u64,
}

/// Both ends.
pub fn loop_handoff() -> (LoopHandle, OperatorRequests) {
    let (realtime, background) = handoff();
    let differ = Arc::new(AtomicBool::new(false));
    let last = Condition::default();
    (
        LoopHandle { queues: realtime, configs_differ: Arc::clone(&differ), last },
        OperatorRequests {
            queues: background,
            configs_differ: differ,
            count: 0,
            last,
            config_hash: 0,
        },
    )
}

impl LoopHandle {
    /// Whether the processes of the instance run with different configurations, by the last check of the background thread.
    pub fn configs_differ(&self) -> bool {
        self.configs_differ.load(Ordering::Relaxed)
    }

    /// Replies to the operator's request that waits, if any, with the result of `answer`; returns request and reply, `None` if
    /// none waits. A request to fly that is read too late is refused. The operator waits by the machine's clock, also for a flight
    /// in virtual time.
    pub fn poll_request(
        &self,
        mut answer: impl FnMut(OperatorCommand) -> ControlResponseV1,
    ) -> Option<(OperatorCommand, ControlResponseV1)> {
        let (number, command, valid_until) = self.queues.request()?;
        let is_late = valid_until.is_set() && Time::now() > valid_until;
        let response = if is_late && begins_flight(command) {
            refused(Cause::Expired, answer(OperatorCommand::Status))
        } else {
            answer(command)
        };
        self.queues.reply((number, response));
        Some((command, response))
    }

    /// Passes a changed condition to the background thread, with the number of changes before it that found the queue full.
    pub fn publish_status(&mut self, condition: Condition) {
        if condition.differs_from(&self.last) {
            self.last = Condition { unlogged: self.queues.dropped_notes(), ..condition };
            self.queues.note(self.last);
        }
    }
}

impl OperatorRequests {
    /// Tells the loop whether the processes of the instance run with different configurations.
    pub fn note_configs_differ(&self, differ: bool) {
        self.configs_differ.store(differ, Ordering::Relaxed);
    }

    /// Takes in and logs the changes of the condition.
    fn take_changes(&mut self) {
        for condition in self.queues.notes() {
            log(&condition);
            if condition.auto_takeoff == AutoTakeoff::Refused
                && self.last.auto_takeoff != AutoTakeoff::Refused
            {
                tracing::warn!(
                    "no take-off at start: the vehicle is not simulated; arm with `oqtal ctl arm` when everybody is clear"
                );
            }
            self.last = condition;
        }
    }

    /// Passes a request to the loop and waits for the reply, at most [`REPLY_TIMEOUT`]: the loop may stand still.
    fn ask(&mut self, request: ControlRequestV1) -> ControlResponseV1 {
        let Condition { mode, state, cause, obstacles, .. } = self.last;
        let config_hash = self.config_hash;
        let reply = |answer: Answer| {
            let answer = answer.code();
            ControlResponseV1 { answer, mode, state, cause, config_hash, obstacles }
        };
        let Some(command) = OperatorCommand::from_code(request.command) else {
            return reply(Answer::Refused);
        };
        let is_other = request.config_hash != 0 && request.config_hash != config_hash;
        if is_other && begins_flight(command) {
            return refused(Cause::OtherConfig, reply(Answer::Refused));
        }
        self.count += 1;
        if self.queues.send((self.count, command, request.valid_until)).is_err() {
            return reply(Answer::Refused);
        }
        let timeout = crossbeam_channel::after(REPLY_TIMEOUT);
        loop {
            crossbeam_channel::select! {
                recv(self.queues.replies()) -> answer => match answer {
                    Ok((number, response)) if number == self.count => {
                        return ControlResponseV1 { config_hash, ..response };
                    }
                    // The late reply to an earlier request.
                    Ok(_) => {}
                    Err(_) => return reply(Answer::Refused),
                },
                recv(timeout) -> _ => return reply(Answer::Accepted),
            }
        }
    }
}

/// Whether motors may start because of `command`: it must not be executed late, or under another configuration than expected.
fn begins_flight(command: OperatorCommand) -> bool {
    matches!(command, OperatorCommand::Arm | OperatorCommand::Fly)
}

/// The refusal for the reason `cause`, with mode and state as in `present`.
fn refused(cause: Cause, present: ControlResponseV1) -> ControlResponseV1 {
    ControlResponseV1 { answer: Answer::Refused.code(), cause: cause.code(), ..present }
}

/// The processes whose configuration must be that of the daemon.
const PEERS: [Role; 4] = [Role::Plant, Role::Mocap, Role::Receiver, Role::Bridge];
/// Time after which the health of a process that ended no longer counts.
const PEER_TIMEOUT: Span = Span::from_millis(3000);

/// Health of another process of the instance.
struct Peer {
    reader: Reader<HealthV1>,
    last: Option<HealthV1>,
}

impl Peer {
    fn open(bus: &Bus, role: Role) -> Result<Self, BusError> {
        Ok(Self { reader: bus.reader(&role.health())?, last: None })
    }

    /// Whether the process lives and runs with another configuration than that with `hash`. A message that cannot be read counts
    /// as none.
    fn has_other_config(&mut self, hash: u64) -> bool {
        if let Ok(Some((_, health))) = self.reader.latest() {
            self.last = Some(health);
        }
        self.last.is_some_and(|health| {
            let is_other = health.compared_config().is_some_and(|other| other != hash);
            is_other && Time::now().since(health.time) < PEER_TIMEOUT
        })
    }
}

/// The background thread of the daemon: logs, health, operator requests.
pub struct DaemonWorker {
    requests: OperatorRequests,
    server: ControlServer,
    heartbeat: Heartbeat,
    health: Health,
    config_hash: u64,
    peers: Vec<Peer>,
    law: Option<LawListener>,
    // The ports live as long as the bus they were opened on.
    _bus: Bus,
}

impl DaemonWorker {
    /// Opens the control service and the health topic.
    ///
    /// # Errors
    /// Another daemon serves the instance, or the bus refuses.
    pub fn open(
        context: &ProcessContext,
        requests: OperatorRequests,
        connected: Sender<OwnedFd>,
    ) -> Result<Self, Failure> {
        let bus = context.bus()?;
        let is_external = context.config.control.is_external();
        let law = is_external.then(|| LawListener::open(context.paths()?.law(), connected));
        let law = law.transpose()?;
        let requests = OperatorRequests { config_hash: context.config.hash(), ..requests };
        let (server, heartbeat) = (bus.control_server()?, context.heartbeat(&bus)?);
        let peers = PEERS.iter().map(|role| Peer::open(&bus, *role)).collect::<Result<_, _>>()?;
        let (health, config_hash) = (context.health.clone(), context.config.hash());
        Ok(Self { requests, server, heartbeat, health, config_hash, peers, law, _bus: bus })
    }
}

impl BackgroundWorker for DaemonWorker {
    fn poll(&mut self) {
        let Self { requests, server, heartbeat, health, config_hash, peers, law, .. } = self;
        requests.take_changes();
        law.iter_mut().for_each(LawListener::poll);
        // Every peer is checked, so that none keeps an old message.
        let others =
            peers.iter_mut().filter_map(|peer| peer.has_other_config(*config_hash).then_some(()));
        requests.note_configs_differ(others.count() > 0);
        if let Some((text, ..)) = requests.last.text() {
            health.set_status(text);
        }
        if let Err(error) = server.serve(|request| requests.ask(request)) {
            tracing::warn!("{error}");
        }
        let Condition { mode, state, cause, obstacles, unlogged, .. } = requests.last;
        let health = HealthV1 { state, mode, cause, obstacles, unlogged, ..HealthV1::default() };
        if let Err(error) = heartbeat.beat(health) {
            tracing::warn!("{error}");
        }
    }
}

fn log(condition: &Condition) {
    let Some((text, state, cause)) = condition.text() else { return };
    let (state_name, cause_name) = (state.to_string(), cause.to_string());
    let sequence = condition.command_sequence;
    if state == SafetyState::Nominal {
        tracing::info!(state = state_name, sequence, "{text}");
    } else {
        tracing::warn!(state = state_name, cause = cause_name, sequence, "{text}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asks(command: OperatorCommand) -> ControlRequestV1 {
        ControlRequestV1::of(command)
    }

    fn answers(answer: Answer) -> ControlResponseV1 {
        ControlResponseV1 { answer: answer.code(), ..ControlResponseV1::default() }
    }

    #[test]
    fn no_operator_gets_the_reply_to_the_request_of_another() {
        let (handle, mut requests) = loop_handoff();
        // The loop stands still: the first operator gets no reply from it.
        let first = requests.ask(asks(OperatorCommand::Status));
        assert_eq!(first.answer, Answer::Accepted.code());
        let second = std::thread::spawn(move || requests.ask(asks(OperatorCommand::Land)));
        assert!(handle.poll_request(|_| answers(Answer::Refused)).is_some());
        // The loop runs again once the second request is there, too.
        let land = |command| {
            assert_eq!(command, OperatorCommand::Land);
            answers(Answer::Done)
        };
        while handle.poll_request(land).is_none() {
            std::thread::yield_now();
        }
        let second = second.join().unwrap().answer;
        // Accepted: this machine took longer for the above than an operator waits.
        assert!([Answer::Done, Answer::Accepted].map(Answer::code).contains(&second));
    }

    #[test]
    fn a_request_to_fly_expires_and_a_stop_does_not() {
        let (handle, requests) = loop_handoff();
        let long_ago = Time::now();
        for (command, is_executed) in [
            (OperatorCommand::Arm, false),
            (OperatorCommand::Fly, false),
            (OperatorCommand::Land, true),
            (OperatorCommand::Stop, true),
        ] {
            requests.queues.send((0, command, long_ago)).unwrap();
            let mut executed = false;
            while Time::now() == long_ago {}
            let asked = handle.poll_request(|asked| {
                executed |= asked == command;
                answers(Answer::Done)
            });
            assert_eq!(asked.map(|(command, _)| command), Some(command));
            let (_, response) = requests.queues.replies().recv().unwrap();
            assert_eq!(executed, is_executed, "{command}");
            let is_refused = response.cause == Cause::Expired.code();
            assert_eq!(is_refused, !is_executed, "{command}");
        }
    }

    #[test]
    fn a_request_to_fly_with_another_configuration_is_refused() {
        let (_handle, requests) = loop_handoff();
        let mut requests = OperatorRequests { config_hash: 7, ..requests };
        let request = ControlRequestV1 { config_hash: 8, ..asks(OperatorCommand::Arm) };
        let response = requests.ask(request);
        assert_eq!((response.answer, response.config_hash), (Answer::Refused.code(), 7));
        assert_eq!(response.cause, Cause::OtherConfig.code());
        for config_hash in [0, 7] {
            let response = requests.ask(ControlRequestV1 { config_hash, ..request });
            assert_eq!(response.answer, Answer::Accepted.code());
        }
        let stop = requests.ask(ControlRequestV1 { config_hash: 8, ..asks(OperatorCommand::Stop) });
        assert_eq!(stop.answer, Answer::Accepted.code());
    }

    #[test]
    fn changes_that_found_the_queue_full_are_counted_in_the_next_one() {
        let (mut handle, mut requests) = loop_handoff();
        let condition = |mode| Condition { mode, ..Condition::default() };
        let mut mode = 0;
        let mut publish = |handle: &mut LoopHandle| {
            mode = 1 - mode;
            handle.publish_status(condition(mode));
        };
        while handle.queues.dropped_notes() < 3 {
            publish(&mut handle);
        }
        requests.take_changes();
        assert_eq!(requests.last.unlogged, 0);
        publish(&mut handle);
        requests.take_changes();
        assert_eq!(requests.last.unlogged, 3);
    }
}
