//! A request to the daemon, and its answer.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure};

/// Time within which a running daemon answers.
const ANSWER_TIMEOUT: Span = Span::from_millis(2000);
/// Time between two checks whether an instance has started.
const START_POLL: std::time::Duration = std::time::Duration::from_millis(20);

/// Sends a command that expires to the daemon; `None` without an answer. `expected`: hash of the configuration that the daemon
/// must run with.
pub fn request(
    bus: &Bus,
    command: OperatorCommand,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    send(bus, ControlRequestV1::of(command), expected)
}

/// As [`request`], for a request with a content.
pub fn send(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    send_signed(bus, request.by("oqtal"), expected)
}

/// As [`send`], for a request with its author.
pub fn send_signed(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    let valid_until = Time::now() + ANSWER_TIMEOUT;
    let config_hash = expected.unwrap_or(0);
    let request = ControlRequestV1 { valid_until, config_hash, ..request };
    bus.control_client()?.ask(request, ANSWER_TIMEOUT)
}

/// The bus of the instance at `paths`, which may just be starting.
///
/// # Errors
/// No process of the instance runs (exit code 75), or the bus refuses.
pub fn running_bus(paths: &InstancePaths) -> Result<Bus, Failure> {
    let give_up = Time::now() + ANSWER_TIMEOUT;
    loop {
        if let Some(bus) = Bus::open_running(paths)? {
            return Ok(bus);
        }
        if Time::now() > give_up {
            return Err(silent(paths));
        }
        std::thread::sleep(START_POLL);
    }
}

/// Failure of a command without an answer on the bus of a running instance: names a daemon that runs and does not answer.
pub fn unanswered(bus: &Bus) -> Failure {
    let paths = bus.paths();
    let instance = &paths.instance;
    let Ok(Some(daemon)) = bus.holder(&Role::Daemon.health()) else { return silent(paths) };
    let message = format!(
        "{daemon} runs on instance `{instance}`, but does not answer: it hangs, or was stopped by a signal; continue it by SIGCONT, or end \
         it; `oqtal ctl stop --instance {instance}` stops the motors"
    );
    Failure::new(Exit::Peer, message)
}

/// Failure of a command to an instance without a daemon on its bus: names a daemon that runs nevertheless.
pub fn silent(paths: &InstancePaths) -> Failure {
    let InstancePaths { instance, root } = paths;
    let mut daemons = ObeyingProcess::all();
    daemons.retain(|process| !process.is_vehicle && process.is_of_instance(instance));
    let here = daemons.iter().find(|daemon| daemon.is_under(paths));
    let (exit, message) = match (here, daemons.first()) {
        (Some(daemon), _) => (
            Exit::Peer,
            format!(
                "the daemon of instance `{instance}`, process {}, cannot be reached: it is starting, or files of the instance were \
                 removed, after which it lands and ends; `oqtal ctl land` and `stop` reach it",
                daemon.pid
            ),
        ),
        (None, Some(daemon)) => (
            if daemon.is_ours() { Exit::Peer } else { Exit::Permission },
            format!(
                "no daemon answers on instance `{instance}` in {}; process {} of user {} is one under another root: run as that user, or \
                 give its --root",
                root.display(),
                daemon.pid,
                daemon.user
            ),
        ),
        (None, None) => (
            Exit::Peer,
            format!(
                "no daemon answers on instance `{instance}`; start one with `oqtal daemon run --instance {instance}`"
            ),
        ),
    };
    Failure::new(exit, message)
}
