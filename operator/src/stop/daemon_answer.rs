//! The request of a stop to the daemon, and its answer.

use std::sync::mpsc::{Receiver, channel};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::program::beside;

use crate::running::left;

/// Time after which the report of a stop is printed.
pub(super) const REPORT_TIMEOUT: Span = Span::from_millis(950);

/// Answer of the daemon; `None` if it did not answer in time.
pub(super) type DaemonAnswer = Result<Option<ControlResponseV1>, String>;

/// The answer of a daemon that obeys. Its loop answers at the beginning of a tick: the mode may still be that of the tick before the stop,
/// and is asked for again then.
pub(super) fn after_obedience(
    answer: DaemonAnswer,
    paths: &InstancePaths,
    give_up: Time,
) -> DaemonAnswer {
    let flies = |answer: &DaemonAnswer| {
        let response = answer.as_ref().ok().and_then(Option::as_ref);
        let mode = response.and_then(|response| Mode::from_code(response.mode));
        mode.is_some_and(Mode::commands_motors)
    };
    let mut answer = answer;
    while flies(&answer) && Time::now() < give_up {
        let status = ask_daemon(paths, ControlRequestV1::of(OperatorCommand::Status));
        match status.recv_timeout(left(give_up)) {
            Ok(Ok(Some(newer))) => answer = Ok(Some(newer)),
            _ => break,
        }
    }
    answer
}

/// Sends the request on a separate thread, which is abandoned after the time-out: a suspended process may hold the lock of the
/// instance.
pub(super) fn ask_daemon(
    paths: &InstancePaths,
    request: ControlRequestV1,
) -> Receiver<DaemonAnswer> {
    let (answers, answer) = channel();
    let paths = paths.clone();
    beside(move || {
        let asked = match Bus::open_running(&paths) {
            Ok(Some(bus)) => bus
                .control_client()
                .and_then(|client| client.ask(request, REPORT_TIMEOUT.scaled(0.8)))
                .map_err(|error| error.to_string()),
            Ok(None) => Err(format!("nobody in {}", paths.directory().display())),
            Err(error) => Err(error.to_string()),
        };
        // Fails after the time-out, when the receiver has been dropped.
        let _ = answers.send(asked);
    });
    answer
}

/// The answer as a line of the report.
pub(super) fn said(answer: &DaemonAnswer) -> &str {
    match answer {
        Ok(Some(_)) => "the daemon answered",
        Ok(None) => "no answer",
        Err(reason) => reason,
    }
}
