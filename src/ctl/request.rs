//! A request to the daemon, and its answer.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};

/// Time within which a running daemon answers.
const ANSWER_TIMEOUT: Span = Span::from_millis(2000);

/// Sends a command that expires to the daemon; `None` without an answer. `expected`: hash of the configuration that the daemon
/// must run with.
pub fn request(
    bus: &Bus,
    command: OperatorCommand,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    let request = ControlRequestV1 {
        valid_until: Time::now() + ANSWER_TIMEOUT,
        config_hash: expected.unwrap_or(0),
        ..ControlRequestV1::of(command)
    };
    bus.control_client()?.ask(request, ANSWER_TIMEOUT)
}

/// Failure of a command without an answer.
pub fn silent(instance: &str) -> Failure {
    let message = format!(
        "no daemon answers on instance `{instance}`; start one with `oqtal daemon run --instance {instance}`"
    );
    Failure::new(Exit::Peer, message)
}
