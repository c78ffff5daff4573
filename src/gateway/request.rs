//! Requests of programs, executed on threads beside the reception: a daemon that hangs delays neither a stop nor a landing.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::Scope;

use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::Time;
use oqtal_operator::request::ANSWER_TIMEOUT;
use oqtal_operator::{AddressedInstance, CtlRequest, request_of};
use oqtal_runtime::process::Failure;
use oqtal_runtime::stop::StopFlag;

use super::protocol::GatewayReply;
use super::socket::{GatewaySocket, Sender};

/// Number of requests that may wait in one queue.
const QUEUE: usize = 64;

/// A request of a program.
struct GatewayRequest {
    command: CtlRequest,
    arguments: Vec<String>,
    sender: Sender,
    /// Instant after which it was sent.
    sent_after: Time,
    /// Number of stops and landings that were requested before it \[-\].
    endings_before: u64,
}

impl GatewayRequest {
    /// Reason not to execute the request at `now`, after `endings` stops and landings; `None` for a stop or a landing. A request that
    /// waited must not take effect after one of them, nor on a later flight.
    fn refusal(&self, endings: u64, gateway_ends: bool, now: Time) -> Option<String> {
        if self.command.ends_flight() {
            return None;
        }
        let waited = now.since(self.sent_after);
        let has_effect = !matches!(self.command, CtlRequest::Status | CtlRequest::Get);
        if endings != self.endings_before && has_effect {
            Some("a stop or a landing was requested after it".to_owned())
        } else if waited > ANSWER_TIMEOUT {
            let limit_s = ANSWER_TIMEOUT.seconds();
            Some(format!("it waited longer than {limit_s} s for the daemon"))
        } else {
            gateway_ends.then(|| "the gateway ends".to_owned())
        }
    }

    /// `request` with its author and its time.
    fn sign(&self, request: ControlRequestV1) -> ControlRequestV1 {
        let asked_at = self.sent_after;
        let valid_until = asked_at + ANSWER_TIMEOUT;
        ControlRequestV1 { asked_at, valid_until, ..self.sender.sign(request) }
    }
}

/// Queues of requests, each with a thread.
pub struct RequestQueues<'a> {
    stops: SyncSender<GatewayRequest>,
    landings: SyncSender<GatewayRequest>,
    others: SyncSender<GatewayRequest>,
    endings: &'a AtomicU64,
}

impl RequestQueues<'_> {
    /// Passes a request of `sender`, sent after the first and received at the second of the instants, to the thread that replies.
    ///
    /// # Errors
    /// The request is unknown, its arguments are wrong, or too many wait; the sender, with the reason.
    pub fn push(
        &self,
        (name, arguments): (&str, Vec<String>),
        sender: Sender,
        (sent_after, received_at): (Time, Time),
    ) -> Result<(), (Sender, String)> {
        let known = CtlRequest::named(name).and_then(|command| {
            let valid = request_of(command, &arguments).map_err(|failure| failure.message);
            valid.map(|_| command)
        });
        let command = match known {
            Ok(command) => command,
            Err(reason) => return Err((sender, reason)),
        };
        let queue = match command {
            CtlRequest::Stop => &self.stops,
            CtlRequest::Land => &self.landings,
            _ => &self.others,
        };
        let endings_before =
            self.endings.fetch_add(u64::from(command.ends_flight()), Ordering::AcqRel);
        // An end of a flight also ends one that was requested meanwhile.
        let sent_after = if command.ends_flight() { received_at } else { sent_after };
        let request = GatewayRequest { command, arguments, sender, sent_after, endings_before };
        queue.try_send(request).map_err(|error| {
            let (TrySendError::Full(request) | TrySendError::Disconnected(request)) = error;
            (request.sender, format!("{QUEUE} requests wait for the daemon already"))
        })
    }
}

/// Executor of the requests to one instance.
pub struct Executor<'a> {
    paths: &'a InstancePaths,
    socket: &'a dyn GatewaySocket,
    /// Set once the gateway ends.
    end: &'a StopFlag,
    /// Number of stops and landings requested so far \[-\].
    endings: AtomicU64,
}

impl<'a> Executor<'a> {
    /// Executor of the requests to the instance at `paths`; replies over `socket`.
    pub fn new(paths: &'a InstancePaths, socket: &'a dyn GatewaySocket, end: &'a StopFlag) -> Self {
        Self { paths, socket, end, endings: AtomicU64::new(0) }
    }

    /// Starts a thread for each queue. A thread ends when its queue was dropped and is empty.
    pub fn start<'s>(&'s self, threads: &'s Scope<'s, '_>) -> RequestQueues<'s> {
        let [stops, landings, others] = [(); 3].map(|()| {
            let (queue, requests) = sync_channel(QUEUE);
            threads.spawn(move || serve(&requests, self.socket, |request| self.execute(request)));
            queue
        });
        RequestQueues { stops, landings, others, endings: &self.endings }
    }

    fn execute(&self, request: &GatewayRequest) -> GatewayReply {
        let endings = self.endings.load(Ordering::Acquire);
        if let Some(reason) = request.refusal(endings, self.end.is_set(), Time::now()) {
            return GatewayReply::refused(reason);
        }
        let command = (request.command, &request.arguments[..]);
        let address = AddressedInstance::at(self.paths);
        let result = oqtal_operator::execute(&address, command, None, |body| request.sign(body));
        let refused = |failure: Failure| GatewayReply::refused(failure.message);
        result.map_or_else(refused, GatewayReply::done)
    }
}

/// Executes the requests of a queue by `execute`, and replies. Stops that wait together, or landings, are executed once, as the newest
/// of them: executed one after another, the last would end a flight that began long after it was requested.
fn serve(
    requests: &Receiver<GatewayRequest>,
    socket: &dyn GatewaySocket,
    execute: impl Fn(&GatewayRequest) -> GatewayReply,
) {
    while let Ok(request) = requests.recv() {
        let mut merged = vec![request];
        if merged[0].command.ends_flight() {
            merged.extend(requests.try_iter());
        }
        let reply = merged.last().map(&execute).map(|reply| reply.to_json());
        for (request, reply) in merged.iter().zip(reply.iter().cycle()) {
            socket.reply(&request.sender, reply);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::Mutex;

    use oqtal_bus::code::OperatorCommand;
    use oqtal_bus::time::Span;

    use super::super::socket::Incoming;
    use super::*;

    const SENT_AFTER: Time = Time::VIRTUAL_START;

    fn request(command: CtlRequest, port: u16) -> GatewayRequest {
        let sender = Sender::network(([10, 0, 0, 7], port).into(), 1);
        GatewayRequest {
            command,
            arguments: Vec::new(),
            sender,
            sent_after: SENT_AFTER,
            endings_before: 3,
        }
    }

    /// Programs that were replied to.
    #[derive(Default)]
    struct Replies(Mutex<Vec<String>>);

    impl GatewaySocket for Replies {
        fn address(&self) -> String {
            String::new()
        }

        fn receive(&self, _: &mut [u8]) -> Result<Incoming, Failure> {
            Ok(Incoming::Empty)
        }

        fn wait(&self) {}

        fn reply(&self, sender: &Sender, _: &str) {
            self.0.lock().unwrap().push(sender.program.clone());
        }
    }

    #[test]
    fn stops_that_wait_together_are_executed_once_and_each_has_a_reply() {
        for (command, number) in
            [(CtlRequest::Stop, 1), (CtlRequest::Land, 1), (CtlRequest::Hover, 3)]
        {
            let (queue, requests) = sync_channel(3);
            for port in [1, 2, 3] {
                queue.send(request(command, port)).unwrap();
            }
            drop(queue);
            let (replies, executions) = (Replies::default(), Cell::new(0));
            serve(&requests, &replies, |request| {
                executions.set(executions.get() + 1);
                assert!(number == 3 || request.sender.program.ends_with(":3"));
                GatewayReply::done(String::new())
            });
            let replied = replies.0.into_inner().unwrap();
            assert_eq!(replied, [1, 2, 3].map(|port| format!("10.0.0.7:{port}")));
            assert_eq!(executions.get(), number, "{command:?}");
        }
    }

    #[test]
    fn a_request_that_waited_for_a_stop_or_for_two_seconds_is_refused() {
        let arm = request(CtlRequest::Arm, 1);
        let at = |millis| SENT_AFTER + Span::from_millis(millis);
        let refusal = |endings, gateway_ends, now| arm.refusal(endings, gateway_ends, now);
        assert_eq!(refusal(3, false, at(2000)), None);
        assert!(refusal(3, false, at(2001)).unwrap().contains("it waited longer than 2 s"));
        assert!(refusal(4, false, at(0)).unwrap().contains("requested after it"));
        assert!(refusal(3, true, at(0)).unwrap().contains("the gateway ends"));
        for command in [CtlRequest::Stop, CtlRequest::Land] {
            assert_eq!(request(command, 1).refusal(9, true, at(9000)), None);
        }
    }

    #[test]
    fn a_landing_is_dated_by_its_reception_since_it_also_ends_a_flight_requested_meanwhile() {
        let endings = AtomicU64::new(0);
        let [(stops, _), (landings, landed), (others, armed)] = [(); 3].map(|()| sync_channel(1));
        let queues = RequestQueues { stops, landings, others, endings: &endings };
        let received_at = SENT_AFTER + Span::from_millis(700);
        for (name, requests, dated) in [("land", landed, received_at), ("arm", armed, SENT_AFTER)] {
            let sender = Sender::network(([10, 0, 0, 7], 1).into(), 1);
            let pushed = queues.push((name, Vec::new()), sender, (SENT_AFTER, received_at));
            assert!(pushed.is_ok() && requests.recv().unwrap().sent_after == dated, "{name}");
        }
    }

    #[test]
    fn a_request_is_dated_before_its_wait() {
        let body = ControlRequestV1::of(OperatorCommand::Arm).by("oqtal");
        let ControlRequestV1 { asked_at, valid_until, .. } = request(CtlRequest::Arm, 1).sign(body);
        assert_eq!(asked_at, SENT_AFTER);
        assert_eq!(valid_until, SENT_AFTER + ANSWER_TIMEOUT);
    }
}
