//! The loop's end of the hand-off of requests: when a request may still be executed.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::code::{Answer, Cause, OperatorCommand};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::handoff::RtHandle;

use super::answer::refused;
use crate::condition::Condition;
use crate::live::FlightChange;

/// Time for which a flight that was refused until the vehicle is at rest counts as requested: operators repeat the request every 50 ms.
const AWAITED: Span = Span::from_millis(200);

/// Number by which a request and its reply find each other.
pub(super) type RequestNumber = u64;
pub(super) type NumberedRequest = (RequestNumber, LoopRequest, Validity);
/// The reply, with what the request replaced, to be dropped on the background thread.
pub(super) type NumberedReply = (RequestNumber, ControlResponseV1, LoopRequest);

/// Times of a request, by the clock of the machine, and whether it is repeated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Validity {
    /// Instant at which it was made; unset for an unknown one.
    pub(super) asked_at: Time,
    /// Instant after which it must not begin a flight; unset for no limit.
    pub(super) until: Time,
    /// Whether the operator repeats it until the vehicle is at rest.
    pub(super) is_repeated: bool,
}

impl Validity {
    pub(super) fn of(request: &ControlRequestV1) -> Self {
        let ControlRequestV1 { asked_at, valid_until: until, repeated, .. } = *request;
        Self { asked_at, until, is_repeated: repeated != 0 }
    }

    /// Whether the operator does not wait for the answer any longer.
    pub(super) fn is_over(&self) -> bool {
        self.until.is_set() && Time::now() > self.until
    }
}

/// A request to the loop.
#[derive(Debug)]
pub enum LoopRequest {
    /// A request that consists of its command.
    Operator {
        /// The command.
        command: OperatorCommand,
        /// Number of the request on topic `event`; 0 for none.
        event: u64,
    },
    /// A change of the flight or its settings.
    Change {
        /// The command.
        command: OperatorCommand,
        /// Number of the request on topic `event`.
        event: u64,
        /// The change.
        change: FlightChange,
    },
}

impl LoopRequest {
    /// The command, with the number of the request on topic `event`; 0 for none.
    pub(super) fn name(&self) -> (OperatorCommand, u64) {
        match self {
            Self::Operator { command, event } | Self::Change { command, event, .. } => {
                (*command, *event)
            }
        }
    }
}

/// The real-time thread's end of the hand-off.
#[derive(Debug)]
pub struct LoopHandle {
    pub(super) queues: RtHandle<Condition, NumberedRequest, NumberedReply>,
    configs_differ: Arc<AtomicBool>,
    /// The condition of the last tick.
    present: Condition,
    /// The condition last reported to the background thread.
    last: Condition,
    /// Instant of the last stop, landing or disarming on request, by the clock of the machine; unset before one.
    called_off_at: Time,
    /// Instant of the last landing by request or signal that was not refused, by the clock of the machine; unset before one.
    landed_at: Time,
    /// Last request to fly that is repeated until the vehicle is at rest: the instants at which it was made and refused; `None` once it was
    /// given up or called off.
    awaited: Option<[Time; 2]>,
}

impl LoopHandle {
    /// The loop's end of `queues`.
    pub(super) fn new(
        queues: RtHandle<Condition, NumberedRequest, NumberedReply>,
        configs_differ: Arc<AtomicBool>,
    ) -> Self {
        let [present, last] = [Condition::default(); 2];
        let [called_off_at, landed_at] = [Time::UNSET; 2];
        Self { queues, configs_differ, present, last, called_off_at, landed_at, awaited: None }
    }

    /// Whether the processes of the instance run with different configurations, by the last check of the background thread.
    pub fn configs_differ(&self) -> bool {
        self.configs_differ.load(Ordering::Relaxed)
    }

    /// Calls off all flights that were requested before `at`.
    pub fn call_off(&mut self, at: Time) {
        self.called_off_at = self.called_off_at.max(at);
        self.awaited = None;
    }

    /// Records the reply `response` to a landing requested at `asked_at`.
    pub fn note_landing(&mut self, asked_at: Time, response: &ControlResponseV1) {
        if response.answer != Answer::Refused.code() {
            self.landed_at = self.landed_at.max(asked_at);
        }
    }

    /// Whether a request to fly is repeated until the vehicle is at rest.
    fn is_awaited(&self) -> bool {
        self.awaited.is_some_and(|[_, refused_at]| Time::now().since(refused_at) < AWAITED)
    }

    /// Replies to the operator's request that waits, if any, with the result of `answer`; returns its command, its number on topic
    /// `event` and the reply, `None` if none waits. A request to fly that is read too late, or was made before one that ends flights,
    /// is refused. A landing that calls such a request off succeeds, as one in flight; so does a repeated one, whose first reply was lost,
    /// and one that a signal has executed. The operator waits by the machine's clock, also for a flight in virtual time.
    pub fn poll_request(
        &mut self,
        mut answer: impl FnMut(&mut LoopRequest) -> ControlResponseV1,
    ) -> Option<(OperatorCommand, u64, ControlResponseV1)> {
        let (number, mut request, validity) = self.queues.request()?;
        let Validity { asked_at, is_repeated, .. } = validity;
        let (command, event) = request.name();
        let is_late = validity.is_over() && must_be_timely(command);
        let is_called_off = asked_at.is_set() && asked_at < self.called_off_at;
        let mut status = LoopRequest::Operator { command: OperatorCommand::Status, event: 0 };
        let response = if is_called_off && command.begins_flight() {
            refused(Cause::CalledOff, answer(&mut status))
        } else if is_late {
            refused(Cause::Expired, answer(&mut status))
        } else {
            answer(&mut request)
        };
        let is_refused = response.answer == Answer::Refused.code();
        let is_executed = asked_at.is_set() && asked_at <= self.landed_at;
        let response = match command {
            OperatorCommand::Land if is_refused && (is_executed || self.is_awaited()) => {
                answer(&mut status)
            }
            _ => response,
        };
        if command == OperatorCommand::Land {
            self.note_landing(asked_at, &response);
        }
        if command.ends_flight() {
            let now = Time::now();
            self.call_off(if asked_at.is_set() { asked_at.min(now) } else { now });
        } else if command.begins_flight() && is_repeated && response.comes_to_rest() {
            self.awaited = Some([asked_at, Time::now()]);
        } else if command.begins_flight() {
            self.awaited = self.awaited.filter(|[awaited, _]| *awaited != asked_at);
        }
        if command == OperatorCommand::Status && self.present.refusal() != self.last.refusal() {
            self.note_present();
        }
        self.queues.reply((number, response, request));
        Some((command, event, response))
    }

    /// Passes a changed condition to the background thread. New values of the same reason of a refusal wait for a request for the status.
    pub fn publish_status(&mut self, condition: Condition) {
        // The reason of a refusal stays while its warning does.
        let refusal = condition.refusal.or(self.present.refusal());
        self.present = Condition { refusal, ..condition };
        if self.present.differs_from(&self.last) {
            self.note_present();
        }
    }

    /// Passes the present condition to the background thread, with the number of changes before it that found the queue full.
    fn note_present(&mut self) {
        self.last = Condition { unlogged: self.queues.dropped_notes(), ..self.present };
        self.queues.note(self.last);
    }
}

/// Whether `command` must not be executed late.
fn must_be_timely(command: OperatorCommand) -> bool {
    let is_course = matches!(command, OperatorCommand::Goto | OperatorCommand::Trajectory);
    command.begins_flight() || is_course
}
