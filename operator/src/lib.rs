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
//! | `stop.rs` | a stop by every path |
//! | `reach.rs` | processes of an instance, found without the bus |
//! | `status.rs` | observation of a status |
#![forbid(unsafe_code)]

pub mod arm;
mod change;
pub mod land;
mod reach;
mod report;
pub mod request;
pub mod status;
pub mod stop;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_observe::status::InstanceStatus;
use oqtal_runtime::process::Failure;

pub use change::{CtlRequest, request_of};
pub use reach::AddressedInstance;
pub use report::ControlReport;
use request::{request, running_bus, silent};

/// Fails if no daemon answers on `instance`; the message names the alternative `otherwise`.
///
/// # Errors
/// No daemon answers (exit code 75), or the bus refuses.
pub fn require_daemon(bus: &Bus, instance: &str, otherwise: &str) -> Result<(), Failure> {
    if request(bus, OperatorCommand::Status, None)?.is_some() {
        return Ok(());
    }
    let Failure { exit, message } = silent(instance);
    Err(Failure::new(exit, format!("{message}, or {otherwise}")))
}

/// Executes a command like `oqtal ctl`, on the calling thread, and returns the answer as text. `expected`: hash of the
/// configuration that the daemon must run with.
///
/// # Errors
/// No daemon answers, or it refuses; or the motors are not known to be off after a stop.
pub fn execute(
    address: &AddressedInstance,
    (command, expected): (OperatorCommand, Option<u64>),
) -> Result<String, Failure> {
    let response = match command {
        OperatorCommand::Stop => {
            let stop = stop::raise(address)?;
            return stop.check().map(|()| stop.to_string());
        }
        OperatorCommand::Land => land::land(address)?,
        _ => request(&running_bus(&address.paths)?, command, expected)?
            .ok_or_else(|| silent(&address.paths.instance))?,
    };
    let report = ControlReport::new(command, &response, InstanceStatus::default());
    report.check(&response, expected)?;
    Ok(report.to_text(&[]))
}

/// Executes a request with arguments as `oqtal ctl` does, made by the author with whom `sign` signs it, and returns the answer as
/// text.
///
/// # Errors
/// As [`execute`]; or the arguments are not those of the command.
pub fn execute_for(
    address: &AddressedInstance,
    (command, arguments): (CtlRequest, &[String]),
    sign: impl FnOnce(ControlRequestV1) -> ControlRequestV1,
) -> Result<String, Failure> {
    let body = sign(request_of(command, arguments)?);
    let operator = command.command();
    if command.ends_flight() {
        return execute(address, (operator, None));
    }
    let response = request::send_signed(&running_bus(&address.paths)?, body, None)?;
    let response = response.ok_or_else(|| silent(&address.paths.instance))?;
    let report = ControlReport::new(operator, &response, InstanceStatus::default());
    report.check(&response, None)?;
    Ok(report.to_text(&[]))
}

/// Ends a flight with `command`, a landing or a stop; returns whether the daemon or the vehicle obeys.
pub fn end_flight(paths: &InstancePaths, command: OperatorCommand) -> bool {
    if command == OperatorCommand::Stop {
        let stopped = stop::raise(&AddressedInstance::at(paths));
        return stopped.is_ok_and(|stop| stop.vehicle_obeys || stop.daemon_obeys);
    }
    execute(&AddressedInstance::at(paths), (command, None)).is_ok()
}

/// Stops the vehicle of the instance at `paths`; returns the first line of the result.
pub fn stop_text(paths: &InstancePaths) -> String {
    let stopped = execute(&AddressedInstance::at(paths), (OperatorCommand::Stop, None));
    let text = stopped.unwrap_or_else(|failure| failure.message);
    text.lines().next().unwrap_or_default().to_owned()
}
