//! Questions and requests of `oqtal tune --live` to the daemon.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_config::{Config, Setting};
use oqtal_observe::law_query::{NoAnswer, changed_before};
use oqtal_operator::request::{request, unanswered};
use oqtal_operator::{AddressedInstance, CtlRequest, execute as execute_request};
use oqtal_runtime::process::{Exit, Failure};

/// The settings with which the daemon flies now.
///
/// # Errors
/// The daemon does not answer (exit code 75) or has changed too many settings (1), or the copy of its configuration cannot be read.
pub fn present_settings(bus: &Bus) -> Result<Vec<Setting>, Failure> {
    let mut settings = Config::file_settings(&[bus.paths().config()])?;
    let changed = changed_before(bus).map_err(|reason| match reason {
        NoAnswer::Incomplete => Failure::new(
            Exit::Flight,
            "tune --live: more settings were changed in flight than the daemon's answer names; start it with them",
        ),
        NoAnswer::NoDaemon | NoAnswer::Silent => unanswered(bus),
    })?;
    let changed = changed.as_ref().map_or("", |event| event.text.as_str());
    for line in changed.lines().filter(|line| line.contains('=')) {
        settings.push(Setting::parse("daemon", line)?);
    }
    Ok(settings)
}

/// Law and course of the flight, by the daemon's answer.
///
/// # Errors
/// The daemon does not answer (exit code 75).
pub fn present_course(bus: &Bus) -> Result<String, Failure> {
    let answer = request(bus, OperatorCommand::Get, None)?.ok_or_else(|| unanswered(bus))?;
    Ok(answer.text.as_str().lines().next().unwrap_or_default().to_owned())
}

/// Makes a request of an operator; it must not be refused.
pub fn ask(bus: &Bus, command: CtlRequest, arguments: &[String]) -> Result<(), Failure> {
    let address = AddressedInstance::at(bus.paths());
    execute_request(&address, (command, arguments), None, |request| request).map(drop)
}
