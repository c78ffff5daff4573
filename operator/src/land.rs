//! A landing by two paths: a request over the control service and, if it is not answered, a signal to the daemon, whose loop then
//! lands without its background thread.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Mode};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, TelemetryV1};
use oqtal_bus::obeying::{LAND_SIGNAL, ObeyingProcess};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::beside;

use crate::reach::{AddressedInstance, FoundProcesses, Reached, place_of, root_of, signal_all};
use crate::request::silent;
use crate::running::left;

/// Time within which a running daemon answers a request.
const ANSWER_TIMEOUT: Span = Span::from_millis(300);
/// Time after which an unanswered request is followed by a signal; opening the bus takes a part of this time.
const SIGNAL_DELAY: Duration = Duration::from_millis(400);
/// Ticks that may be older than a signal: the stored one, and one whose turn had begun \[-\].
const OLDER_TICKS: u32 = 2;
/// Time between two searches for the daemon.
const SEARCH_PERIOD: Duration = Duration::from_millis(100);
/// Pause between two requests.
const REPEAT_PERIOD: Duration = Duration::from_millis(50);
/// Time-out of the command.
const TIMEOUT: Span = Span::from_millis(950);

/// Answer of the daemon, or its state in flight once it lands; `None` if neither was received.
type LandingAnswer = Result<Option<ControlResponseV1>, BusError>;

/// Pending answer of a daemon under another root.
struct PendingAnswer {
    /// The daemon and its place, as text.
    daemon: String,
    /// Receives the daemon's answer; `None` if the daemon's root is unknown.
    answer: Option<Receiver<LandingAnswer>>,
}

/// Sends `landing` to the daemon of the addressed vehicle, and returns the daemon's answer, and the roots of the daemons if there are
/// several.
///
/// # Errors
/// The daemon was signalled and has not confirmed (exit code 1), no daemon runs (75), or it belongs to another user (77).
pub fn land(
    address: &AddressedInstance,
    landing: ControlRequestV1,
) -> Result<(ControlResponseV1, Vec<PathBuf>), Failure> {
    let reached = Reached::find(address);
    let paths = &reached.paths;
    // The daemon of `paths` is asked first, and signalled if it does not answer; those under other roots are signalled at once and
    // also asked.
    let (elsewhere, mut lines) = request_elsewhere(&reached, landing);
    let is_signalled = Arc::new(AtomicBool::default());
    let answer = request(paths, landing, &is_signalled);
    let give_up = Time::now() + TIMEOUT;
    let (mut answered, mut here) = (answer.recv_timeout(SIGNAL_DELAY), Vec::new());
    while !matches!(answered, Ok(Ok(Some(_)))) {
        // Searched each time: the daemon may be starting.
        let found = FoundProcesses::search(address).addressed;
        let is_here = |process: &&ObeyingProcess| is_daemon(process) && process.is_under(paths);
        here = found.iter().filter(is_here).map(place_of).collect();
        let sent = signal_all(LAND_SIGNAL, found.iter().filter(is_here));
        is_signalled.fetch_or(!sent.is_empty(), Ordering::AcqRel);
        lines.extend(sent);
        if answered.is_ok() || Time::now() >= give_up {
            break;
        }
        answered = answer.recv_timeout(SEARCH_PERIOD);
    }
    lines.sort();
    lines.dedup();
    let (response, said) = match answered {
        Ok(Ok(Some(response))) => (Some(response), None),
        Ok(Err(error)) if lines.is_empty() => return Err(reached.unreachable("land", error)),
        Ok(Err(error)) => (None, Some(error)),
        _ if lines.is_empty() => return Err(reached.nobody("land", silent_text(paths))),
        _ => (None, None),
    };
    if response.is_some() || !elsewhere.is_empty() {
        let silent = if response.is_some() { Vec::new() } else { here };
        return combined((response, silent), elsewhere, give_up)
            .map(|response| (response, several_roots(&reached)))
            .map_err(|silent| unconfirmed(&silent, &paths.instance, &lines));
    }
    Err(unanswered(&reached, lines, said.as_ref()))
}

/// Reason why a daemon that has lost its files does not answer.
fn lost_files(reached: &Reached) -> Option<String> {
    let is_lost =
        |it: &ObeyingProcess| is_daemon(it) && it.is_under(&reached.paths) && it.has_lost_files();
    let reason = "files of the instance were removed, so it lands if it flies, and ends";
    reached.processes.iter().any(is_lost).then(|| reason.to_owned())
}

fn is_daemon(process: &ObeyingProcess) -> bool {
    !process.is_vehicle
}

/// Roots of the daemons; none if all have the same.
fn several_roots(reached: &Reached) -> Vec<PathBuf> {
    let daemons = reached.processes.iter().filter(|process| is_daemon(process));
    let mut roots: Vec<_> = daemons.filter_map(|it| root_of(it, &reached.paths)).collect();
    roots.sort();
    roots.dedup();
    if roots.len() > 1 { roots } else { Vec::new() }
}

/// Signals the daemons under other roots and sends them `landing`; returns their pending answers, and the result of each signal.
fn request_elsewhere(
    reached: &Reached,
    landing: ControlRequestV1,
) -> (Vec<PendingAnswer>, Vec<String>) {
    let is_elsewhere =
        |process: &&ObeyingProcess| is_daemon(process) && !process.is_under(&reached.paths);
    let daemons: Vec<_> = reached.processes.iter().filter(is_elsewhere).collect();
    let lines = signal_all(LAND_SIGNAL, daemons.iter().copied());
    let signalled = Arc::new(AtomicBool::new(true));
    let instance = &reached.paths.instance;
    let ask = |daemon: &&ObeyingProcess| {
        let root = root_of(daemon, &reached.paths);
        let paths = root.map(|root| InstancePaths { instance: instance.clone(), root });
        PendingAnswer {
            daemon: place_of(daemon),
            answer: paths.map(|paths| request(&paths, landing, &signalled)),
        }
    };
    (daemons.iter().map(ask).collect(), lines)
}

/// Returns `response` or, if there is none or it is a refusal, the first answer from another root that is not a refusal: the vehicle of
/// that daemon is the one in flight.
///
/// # Errors
/// The daemons that were signalled and have not answered until `give_up`, `silent` among them: their vehicles may fly.
fn combined(
    (response, mut silent): (Option<ControlResponseV1>, Vec<String>),
    elsewhere: Vec<PendingAnswer>,
    give_up: Time,
) -> Result<ControlResponseV1, Vec<String>> {
    let mut answers = Vec::from_iter(response);
    for PendingAnswer { daemon, answer } in elsewhere {
        match answer.and_then(|answer| answer.recv_timeout(left(give_up)).ok()) {
            Some(Ok(Some(answer))) => answers.push(answer),
            _ => silent.push(daemon),
        }
    }
    let is_refused = |answer: &&ControlResponseV1| answer.answer == Answer::Refused.code();
    let accepted = answers.iter().find(|answer| !is_refused(answer)).or(answers.first());
    accepted.copied().filter(|_| silent.is_empty()).ok_or(silent)
}

/// Failure of a landing that the only daemon of `reached` has not confirmed, or for which this command could not ask the daemon because of
/// `error` or of lost files.
fn unanswered(reached: &Reached, lines: Vec<String>, error: Option<&BusError>) -> Failure {
    let (place, lines) = (reached.paths.flags(), lines.join("\n  "));
    let reason = error.map(ToString::to_string).or_else(|| lost_files(reached));
    let message = match reason {
        Some(reason) => format!(
            "land: requested by signal; this command cannot read whether the daemon lands: {reason}\n  {lines}\n  \
             if the vehicle does not land, `oqtal ctl stop {place}` stops the motors"
        ),
        None => format!(
            "land: requested by signal, but the daemon has not confirmed it; `oqtal ctl stop {place}` stops the motors\n  {lines}\n  \
             control service: no answer"
        ),
    };
    Failure::new(Exit::Flight, message)
}

/// Failure of a landing that the daemons `silent` have not confirmed, after signals with the results `lines`.
fn unconfirmed(silent: &[String], instance: &str, lines: &[String]) -> Failure {
    let message = format!(
        "land: signalled, but not confirmed: {}; `oqtal ctl stop --instance {instance}` stops the motors of all vehicles of that name\n  {}",
        silent.join(", "),
        lines.join("\n  ")
    );
    Failure::new(Exit::Flight, message)
}

fn silent_text(paths: &InstancePaths) -> String {
    // The other lines list running processes, as the failure does.
    let message = silent(paths).message;
    let nobody = message.lines().next().unwrap_or_default();
    format!("land: {nobody}; a flight that begins from now on is not prevented")
}

/// Requests a landing on a separate thread, as the owner of the instance. `is_signalled` once the daemon was signalled.
fn request(
    paths: &InstancePaths,
    landing: ControlRequestV1,
    is_signalled: &Arc<AtomicBool>,
) -> Receiver<LandingAnswer> {
    let (answers, answer) = channel();
    let (paths, is_signalled) = (paths.clone(), Arc::clone(is_signalled));
    beside(move || {
        // Fails after the time-out, when the receiver has been dropped.
        let _ = answers.send(ask(&paths, landing, &is_signalled));
    });
    answer
}

/// Asks the daemon, which may be starting, until its loop answers or, once `is_signalled`, its telemetry shows that it obeys. The
/// request may be repeated: a loop that has not answered in time has accepted it.
fn ask(
    paths: &InstancePaths,
    landing: ControlRequestV1,
    is_signalled: &AtomicBool,
) -> LandingAnswer {
    // Early enough for the command to receive the answer.
    let give_up = Time::now() + TIMEOUT.scaled(0.9);
    paths.become_owner()?;
    let mut accepted = None;
    while Time::now() < give_up {
        let Some(bus) = Bus::open_running(paths)? else { return Ok(accepted) };
        let timeout = ANSWER_TIMEOUT.min(give_up.since(Time::now()));
        let answered = bus.control_client().and_then(|client| client.ask(landing, timeout));
        let answer = answered.ok().flatten();
        if answer.is_some_and(|response| response.answer != Answer::Accepted.code()) {
            return Ok(answer);
        }
        accepted = answer.or(accepted);
        if accepted.is_none() && is_signalled.load(Ordering::Acquire) {
            return await_obedience(&bus, give_up);
        }
        std::thread::sleep(REPEAT_PERIOD);
    }
    Ok(accepted)
}

/// The daemon's state in flight once its telemetry shows the landing that a signal has requested.
fn await_obedience(bus: &Bus, give_up: Time) -> LandingAnswer {
    let mut telemetry = bus.reader(&TELEMETRY)?;
    let mut ticks = 0;
    while Time::now() < give_up {
        if let Some((_, tick)) = telemetry.latest()? {
            ticks += 1;
            if ticks > OLDER_TICKS && has_ended_flight(tick.mode) {
                return Ok(Some(response(&tick)));
            }
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
