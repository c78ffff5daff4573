//! A landing by two paths: a request over the control service and, if it is not answered, a signal to the daemon, whose loop then
//! lands without its background thread.

use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Mode, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, TelemetryV1};
use oqtal_bus::obeying::{LAND_SIGNAL, ObeyingProcess};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::beside;

use crate::reach::{AddressedInstance, Reached};
use crate::request::silent;

/// Time within which a running daemon answers a request.
const ANSWER_TIMEOUT: Span = Span::from_millis(300);
/// Time after which an unanswered request is followed by a signal; opening the bus takes some of it.
const SIGNAL_DELAY: Duration = Duration::from_millis(400);
/// Time after which the command gives up.
const TIMEOUT: Span = Span::from_millis(950);

/// Answer of the daemon, or its state in flight once it lands; `None` if neither was received.
type LandingAnswer = Result<Option<ControlResponseV1>, BusError>;

/// Requests a landing of the addressed vehicle, and returns the daemon's answer.
///
/// # Errors
/// The daemon was signalled and has not confirmed (exit code 1), no daemon runs (75), or it belongs to another user (77).
pub fn land(address: &AddressedInstance) -> Result<ControlResponseV1, Failure> {
    let reached = Reached::find(address);
    let paths = &reached.paths;
    let is_daemon = |process: &ObeyingProcess| !process.is_vehicle;
    // Of several daemons with the same name, one is asked.
    let mut lines = reached.signal(LAND_SIGNAL, |p| is_daemon(p) && !p.is_under(paths));
    let answer = request(paths);
    let mut answered = answer.recv_timeout(SIGNAL_DELAY);
    if let Ok(Ok(Some(response))) = answered {
        return Ok(response);
    }
    lines.extend(reached.signal(LAND_SIGNAL, |p| is_daemon(p) && p.is_under(paths)));
    if answered.is_err() {
        answered = answer.recv_timeout((TIMEOUT - Span::from_millis(400)).to_duration());
    }
    let said = match answered {
        Ok(Ok(Some(response))) => return Ok(response),
        Ok(Err(error)) if lines.is_empty() => return Err(error.into()),
        Ok(Err(error)) => error.to_string(),
        _ if lines.is_empty() => return Err(reached.nobody("land", silent_text(address))),
        _ => "no answer".to_owned(),
    };
    lines.push(format!("control service: {said}"));
    let message = format!(
        "land: requested by signal, but the daemon has not confirmed it; `oqtal ctl stop` stops the motors\n  {}",
        lines.join("\n  ")
    );
    Err(Failure::new(Exit::Flight, message))
}

fn silent_text(address: &AddressedInstance) -> String {
    format!("land: {}", silent(&address.paths).message)
}

/// Requests a landing on a separate thread, as the owner of the instance.
fn request(paths: &InstancePaths) -> Receiver<LandingAnswer> {
    let (answers, answer) = channel();
    let paths = paths.clone();
    beside(move || {
        // Fails after the time-out, when the receiver has been dropped.
        let _ = answers.send(ask(&paths));
    });
    answer
}

/// Asks the daemon and, without an answer, waits until its telemetry shows the landing that the signal requests.
fn ask(paths: &InstancePaths) -> LandingAnswer {
    let give_up = Time::now() + TIMEOUT;
    paths.become_owner()?;
    let Some(bus) = Bus::open_running(paths)? else { return Ok(None) };
    let request = ControlRequestV1::of(OperatorCommand::Land);
    let answered = bus.control_client().and_then(|client| client.ask(request, ANSWER_TIMEOUT));
    if let Ok(Some(response)) = answered {
        return Ok(Some(response));
    }
    let mut telemetry = bus.reader(&TELEMETRY)?;
    while Time::now() < give_up {
        let tick = telemetry.latest()?.map(|(_, tick)| tick);
        if let Some(tick) = tick.filter(|tick| has_ended_flight(tick.mode)) {
            return Ok(Some(response(&tick)));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(None)
}

fn has_ended_flight(mode: u8) -> bool {
    [Mode::Landing, Mode::Disarmed].map(Mode::code).contains(&mode)
}

/// The answer of a daemon in this state.
fn response(tick: &TelemetryV1) -> ControlResponseV1 {
    let TelemetryV1 { mode, state, cause, .. } = *tick;
    let answer = Answer::Accepted.code();
    ControlResponseV1 { answer, mode, state, cause, ..ControlResponseV1::default() }
}
