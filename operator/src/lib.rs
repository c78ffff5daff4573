//! An operator's commands to a running instance: arm, land, stop, changes in flight, status. Used by `oqtal ctl`, the page, the
//! monitor, the gateway and the Python package.
//!
//! | file | subject |
//! |---|---|
//! | `change.rs` | the commands, and their requests to the daemon |
//! | `request.rs` | a request and its answer |
//! | `report.rs` | the answer as text and as JSON |
//! | `arm.rs` | arming: waits until the flight has begun |
//! | `land.rs` | a landing by two paths |
//! | `stop.rs` | a stop by every path; `stop/daemon_answer.rs`: the request to the daemon and its answer |
//! | `next_flight.rs` | commands of the next flight after a stop |
//! | `raised.rs` | stop words raised by a stop |
//! | `running.rs` | processes of an instance on its bus |
//! | `reach.rs` | processes of an instance, found without the bus |
//! | `status.rs` | observation of a status |
#![forbid(unsafe_code)]

pub mod arm;
mod change;
pub mod land;
mod next_flight;
mod raised;
mod reach;
mod report;
pub mod request;
mod running;
pub mod status;
pub mod stop;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::paths::InstancePaths;
use oqtal_observe::status::InstanceStatus;
use oqtal_runtime::process::{Exit, Failure};

pub use change::{CtlRequest, request_of};
pub use reach::{AddressedInstance, namesakes};
pub use report::ControlReport;
use request::{request, running_bus, unanswered};

/// Fails if no daemon answers on `bus`; the message names the alternative `otherwise`.
///
/// # Errors
/// No daemon answers (exit code 75), or the bus refuses.
pub fn require_daemon(bus: &Bus, otherwise: &str) -> Result<(), Failure> {
    if request(bus, OperatorCommand::Status, None)?.is_some() {
        return Ok(());
    }
    let Failure { exit, message } = unanswered(bus);
    let (first, others) = message.split_at(message.find('\n').unwrap_or(message.len()));
    Err(Failure::new(exit, format!("{first}, or {otherwise}{others}")))
}

/// Executes a request like `oqtal ctl`, on the calling thread, made by the author with whom `sign` signs it; returns the answer as
/// text. `expected`: hash of the configuration that the daemon must run with.
///
/// # Errors
/// No daemon answers, or it refuses; the motors are not known to be off after a stop; the arguments are not those of the command.
pub fn execute(
    address: &AddressedInstance,
    (command, arguments): (CtlRequest, &[String]),
    expected: Option<u64>,
    sign: impl FnOnce(ControlRequestV1) -> ControlRequestV1,
) -> Result<String, Failure> {
    let body = sign(request_of(command, arguments)?.by("oqtal"));
    let (response, roots) = match command {
        CtlRequest::Stop => {
            let stop = stop::raise(address, body)?;
            return stop.check().map(|()| stop.to_string());
        }
        CtlRequest::Land => land::land(address, body)?,
        _ => {
            let bus = running_bus(&address.paths)?;
            let answer = match command {
                CtlRequest::Arm => arm::ask_once(&bus, body, expected)?,
                _ => request::send_signed(&bus, body, expected)?,
            };
            (answer.ok_or_else(|| unanswered(&bus))?, Vec::new())
        }
    };
    let (status, paths) = (InstanceStatus::default(), &address.paths);
    let report = ControlReport::new(command.command(), &response, status, paths).under(&roots);
    report.check(&response, expected)?;
    Ok(report.to_text(&[]))
}

/// The answer `response` of the daemon at `paths` to `command`, as text.
///
/// # Errors
/// The daemon refused the command (exit code 1).
pub fn accepted(
    command: OperatorCommand,
    response: &ControlResponseV1,
    expected: Option<u64>,
    paths: &InstancePaths,
) -> Result<String, Failure> {
    let report = ControlReport::new(command, response, InstanceStatus::default(), paths);
    report.check(response, expected)?;
    Ok(report.to_text(&[]))
}

/// Executes `line`, written as after `oqtal ctl`; returns the answer as one line.
pub fn execute_line(paths: &InstancePaths, line: &str) -> String {
    let mut words = line.split_whitespace().map(str::to_owned);
    let command = words.next().unwrap_or_default();
    let result = CtlRequest::named(&command)
        .map_err(|reason| Failure::new(Exit::Usage, reason))
        .and_then(|known| {
            let (address, arguments) = (AddressedInstance::at(paths), Vec::from_iter(words));
            execute(&address, (known, &arguments), None, |request| request)
        });
    let text = result.unwrap_or_else(|failure| failure.message);
    text.lines().map(str::trim).collect::<Vec<_>>().join("; ")
}

/// Ends a flight with `command`, a landing or a stop; returns whether the daemon or the vehicle obeys.
pub fn end_flight(paths: &InstancePaths, command: OperatorCommand) -> bool {
    if command == OperatorCommand::Stop {
        let request = ControlRequestV1::of(command).by("oqtal");
        let stopped = stop::raise(&AddressedInstance::at(paths), request);
        return stopped.is_ok_and(|stop| stop.vehicle_obeys || stop.daemon_obeys);
    }
    let land = (CtlRequest::Land, &[][..]);
    execute(&AddressedInstance::at(paths), land, None, |request| request).is_ok()
}
