//! A stop by every path: `oqtal ctl stop`, Ctrl-C in `oqtal fly`, the page and the monitor.
//!
//! 1. A signal to each process of the vehicle and of the daemon, found in /proc. It needs no file and no memory of the instance.
//! 2. The stop words, where both processes read a stop in their next turn: through the files that the processes hold, which may
//!    have been removed, and through the directory of the instance. Obedience is read from the same words.
//! 3. A request to the daemon over the control service, on a separate thread.

mod daemon_answer;

use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::obeying::{ObeyingProcess, STOP_SIGNAL};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::stop::StopReport;
use oqtal_bus::time::Time;
use oqtal_observe::status::word;
use oqtal_runtime::flight_marker::FlightMarker;
use oqtal_runtime::process::{Exit, Failure};
use serde::Serialize;

use self::daemon_answer::{DaemonAnswer, REPORT_TIMEOUT, after_obedience, ask_daemon, said};
use crate::next_flight::NextFlights;
use crate::raised::RaisedStops;
use crate::reach::{AddressedInstance, FoundProcesses, Reached, signal_all};
use crate::report::listed;
use crate::running::{RunningProcesses, left};

/// Period at which obedience is checked.
const CHECK_PERIOD: Duration = Duration::from_millis(2);

/// Report of a stop: the processes that have obeyed.
#[derive(Debug, Serialize)]
pub struct ObeyedStop {
    command: &'static str,
    /// Whether commands are withheld from the vehicle.
    pub vehicle_obeys: bool,
    /// Whether the vehicle's motors are known to be off.
    pub motors_off: bool,
    /// Whether the daemon commands "disarmed".
    pub daemon_obeys: bool,
    /// Whether a pilot or the vehicle itself has control, so that the stop does not reach the motors.
    another_has_control: bool,
    /// Whether the daemon only observes: it ended no flight and begins none.
    observes_only: bool,
    /// Mode and state of the daemon; empty if it did not answer in time.
    mode: String,
    state: String,
    /// Result of each path.
    paths: Vec<String>,
    /// Commands of the next flight, one for each root; empty if the daemon only observes.
    #[serde(flatten)]
    again: NextFlights,
    /// Roots of the processes, unless the addressed one is the only one.
    #[serde(skip)]
    roots: Vec<PathBuf>,
    /// Whether several daemons were found.
    #[serde(skip)]
    has_daemons: bool,
    /// Vehicles' processes that have not obeyed although others have.
    #[serde(skip)]
    laggards: Vec<String>,
    /// Reason why the answer of the addressed daemon is missing, after a colon; empty if it did not answer in time; `None` if it answered
    /// or does not run.
    #[serde(skip)]
    unanswered: Option<String>,
    /// Reason why the stop is not confirmed.
    #[serde(skip)]
    unconfirmed: Option<Unconfirmed>,
}

/// Reason why a stop is not confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unconfirmed {
    /// This user has no access to the files of the vehicle's process.
    Unreadable,
    /// The vehicle's process has not opened its stop words yet.
    Starting,
    /// The vehicle's process has ended since.
    Ended,
    /// A daemon runs without a process of the vehicle.
    Missing,
    /// The vehicle's process runs, but has not obeyed.
    Hangs,
}

impl Unconfirmed {
    /// Reason why the stop is not confirmed; `None` if no vehicle's process was signalled.
    fn of(reached: &Reached, raised: &RaisedStops) -> Option<Self> {
        let vehicles = || reached.processes.iter().zip(&reached.held).filter(|(p, _)| p.is_vehicle);
        if vehicles().next().is_some() && !vehicles().any(|(process, _)| process.is_running()) {
            return Some(Self::Ended);
        }
        if reached.lacks_vehicle() && vehicles().next().is_some() {
            return Some(Self::Missing);
        }
        let is_unconfirmed = !raised.reach_every_vehicle() && vehicles().next().is_some();
        let is_readable = vehicles().all(|(process, held)| held.is_ok() || !process.is_running());
        match (is_unconfirmed, is_readable) {
            (true, true) => Some(Self::Starting),
            (true, false) => Some(Self::Unreadable),
            (false, _) => vehicles().next().is_some().then_some(Self::Hangs),
        }
    }

    const fn text(self) -> &'static str {
        match self {
            Self::Unreadable => {
                "a vehicle's process was signalled, but this user cannot read whether it has obeyed; repeat as root to know"
            }
            Self::Starting => {
                "a vehicle's process was signalled, but its stop words are not open yet, or were shortened: whether it has obeyed cannot be \
                 read; repeat to know"
            }
            Self::Hangs => {
                "the vehicle's process was signalled, but has not obeyed: it hangs, has no port, or virtual time stands still; the stop stays \
                 raised until it obeys, or until every process of the instance has ended"
            }
            Self::Missing => {
                "a daemon runs without a process of its vehicle, which may fly; what a vehicle under another root has reported does not count"
            }
            Self::Ended => {
                "the vehicle's process has ended meanwhile; no command reaches the vehicle any more"
            }
        }
    }
}

/// Stops the addressed vehicle by every path; `request` is the one sent to its daemon. Returns which processes obey within a second.
/// As root, the calling thread becomes the owner of the instance.
///
/// # Errors
/// No process runs (75), or the instance belongs to another user (77).
pub fn raise(
    address: &AddressedInstance,
    request: ControlRequestV1,
) -> Result<ObeyedStop, Failure> {
    let give_up = Time::now() + REPORT_TIMEOUT;
    let found = FoundProcesses::search(address);
    let mut paths = signal_all(STOP_SIGNAL, &found.addressed);
    let mut reached = Reached::of(found, address);
    let (raised, lines) = raise_words(&mut reached)?;
    paths.extend(lines);
    // Before the processes end, as those of `oqtal fly` do.
    let mut again = NextFlights::of(&reached);
    let answers = ask_daemon(&reached.paths, request);
    let running = reached.lacks_process().then(|| RunningProcesses::beside(&reached.paths));
    // Their answers are not reported; waiting for them lets the requests be made.
    let others: Vec<_> =
        reached.places().iter().skip(1).map(|paths| ask_daemon(paths, request)).collect();
    let (report, answer) = await_obedience(&raised, &reached, &answers, give_up);
    others.iter().for_each(|other| drop(other.recv_timeout(left(give_up))));
    paths.push(format!("control service: {}", said(&answer)));
    let running = running.map(|running| running.newest(give_up)).unwrap_or_default();
    if reached.processes.is_empty() {
        // Some may have started.
        let present = Reached::find(address);
        if present.processes.is_empty() && !(report.motors_off || report.daemon_obeys) {
            raised.withdraw();
            return Err(nobody(&reached, &running));
        }
        again = NextFlights::of(&present);
        again.note_losses(&present);
    }
    again.note_running(&reached, &running);
    let response = answer.as_ref().ok().and_then(Option::as_ref);
    let stop = ObeyedStop::new(report, response);
    again.note_processes(&reached, response, [stop.daemon_obeys, stop.vehicle_obeys]);
    paths.extend(reached.places().iter().filter_map(|place| forbid_automatic(place, &stop)));
    Ok(ObeyedStop {
        paths,
        again: again.unless(stop.observes_only || stop.another_has_control),
        roots: reached.told_roots(address),
        has_daemons: reached.processes.iter().filter(|process| !process.is_vehicle).count() > 1,
        laggards: raised.laggards(),
        unanswered: (response.is_none() && reached.has_addressed_daemon())
            .then(|| answer.as_ref().err().map_or_else(String::new, |error| format!(": {error}"))),
        unconfirmed: Unconfirmed::of(&reached, &raised),
        ..stop
    })
}

/// Prevents an automatic take-off of the next daemon at `place`, also if none runs now; returns a line if that fails. Only its owner can
/// create a removed root again; a running daemon does so when it ends.
fn forbid_automatic(place: &InstancePaths, stop: &ObeyedStop) -> Option<String> {
    if stop.observes_only || !place.root.exists() {
        return None;
    }
    let error = FlightMarker::of(place).ensure_set().err()?;
    Some(format!("flight marker in {}: {error}", place.root.display()))
}

/// Raises the stop in all words; returns the words, and the result of each path.
fn raise_words(reached: &mut Reached) -> Result<(RaisedStops, Vec<String>), Failure> {
    let mut raised = RaisedStops::default();
    let mut paths = raised.raise_held(reached);
    let in_directory = reached.paths.become_owner().and_then(|()| raised.raise_in(&reached.paths));
    let is_nobody = reached.processes.is_empty();
    match in_directory {
        Ok(()) if is_nobody && raised.is_empty() => {
            return Err(nobody(reached, &RunningProcesses::default()));
        }
        Err(error) if is_nobody => return Err(reached.unreachable("stop", error)),
        Err(error) => paths.push(format!("stop words in the directory: {error}")),
        Ok(()) => {}
    }
    Ok((raised, paths))
}

/// Failure of a stop that reached no process; `running` are processes that no stop reaches.
fn nobody(reached: &Reached, running: &RunningProcesses) -> Failure {
    let InstancePaths { instance, root } = &reached.paths;
    let not_prevented = "a flight that begins from now on is not prevented";
    let text = match (reached.elsewhere(), running.listed()) {
        (Some(paths), _) => format!(
            "stop: instance `{instance}` does not run under {}, but under {}: run `oqtal ctl stop {}`",
            root.display(),
            paths.root.display(),
            paths.flags()
        ),
        (None, Some(names)) if running.may_control() => format!(
            "stop: on instance `{instance}`, {names} hold places on the bus, but this process does not find them: no stop has reached them"
        ),
        (None, Some(names)) if running.has_simulator() => format!(
            "stop: no process that obeys a stop runs on instance `{instance}`, only {names}: the simulated vehicle takes its commands over a \
             wire; stop the instance whose bridge sends them"
        ),
        (None, Some(names)) => format!(
            "stop: no process that obeys a stop runs on instance `{instance}`, only {names}: there is nothing to stop; {not_prevented}"
        ),
        (None, None) => format!(
            "stop: no process that obeys a stop runs on instance `{instance}`: there is nothing to stop; {not_prevented}"
        ),
    };
    reached.nobody("stop", text)
}

/// Waits until the vehicle, and the daemon if there is one, obey and have answered, until all have ended, or until `give_up`.
fn await_obedience(
    raised: &RaisedStops,
    reached: &Reached,
    answers: &Receiver<DaemonAnswer>,
    give_up: Time,
) -> (StopReport, DaemonAnswer) {
    let processes = &reached.processes;
    let have_ended = || !processes.is_empty() && !processes.iter().any(ObeyingProcess::is_running);
    let (mut answer, lacks_vehicle) = (None, reached.lacks_vehicle());
    loop {
        let has_ended = have_ended();
        let mut report = raised.report();
        if lacks_vehicle {
            // Others that obey, under another root, do not tell whether this one has stopped.
            (report.vehicle_obeys, report.motors_off) = (false, false);
        }
        let daemon_obeys = !reached.has_daemon() || (report.daemon_obeys && answer.is_some());
        if (report.motors_off && daemon_obeys) || has_ended || Time::now() >= give_up {
            let answer = answer.unwrap_or(Ok(None));
            return match report.daemon_obeys {
                true => (report, after_obedience(answer, &reached.paths, give_up)),
                false => (report, answer),
            };
        }
        match answers.recv_timeout(CHECK_PERIOD) {
            Ok(received) => answer = Some(received),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(CHECK_PERIOD),
        }
    }
}

impl ObeyedStop {
    fn new(report: StopReport, response: Option<&ControlResponseV1>) -> Self {
        let StopReport { vehicle_obeys, motors_off, daemon_obeys, another_has_control } = report;
        let obstacles = response.map(|response| ArmingObstacles::from_bits(response.obstacles));
        Self {
            command: "stop",
            vehicle_obeys,
            motors_off,
            daemon_obeys,
            another_has_control,
            observes_only: obstacles.is_some_and(|it| it.contains(ArmingObstacle::ObservesOnly)),
            mode: word(response.and_then(|response| Mode::from_code(response.mode))),
            state: word(response.and_then(|response| SafetyState::from_code(response.state))),
            paths: Vec::new(),
            again: NextFlights::default(),
            roots: Vec::new(),
            has_daemons: false,
            laggards: Vec::new(),
            unanswered: None,
            unconfirmed: None,
        }
    }

    /// Succeeds if the motors are known to be off.
    ///
    /// # Errors
    /// The vehicle has not reported that its motors are off (exit code 1), or no process of a vehicle obeys (75).
    pub fn check(&self) -> Result<(), Failure> {
        if self.motors_off {
            return Ok(());
        }
        let exit = if self.vehicle_obeys
            || self.another_has_control
            || self
                .unconfirmed
                .is_some_and(|it| !matches!(it, Unconfirmed::Missing | Unconfirmed::Hangs))
        {
            Exit::Flight
        } else {
            Exit::Peer
        };
        Err(Failure::new(exit, self.to_string()))
    }

    /// The state of the addressed vehicles.
    fn vehicle_text(&self) -> Cow<'static, str> {
        match (self.vehicle_obeys, self.motors_off) {
            (_, true) if self.observes_only => "motors off".into(),
            (_, true) => "motors off until `arm`".into(),
            (true, false) => {
                "no command reaches the vehicle any more, but it has not reported that its motors are off".into()
            }
            (false, false) if self.another_has_control => {
                "a pilot or the vehicle itself has control, so no stop is sent to the vehicle: only the remote control stops its motors; the stop \
                 stays raised, and acts if control is given back to the bridge"
                    .into()
            }
            (false, false) if !self.laggards.is_empty() => format!(
                "the other vehicles have obeyed, but not {}, which hangs, or has no port",
                self.laggards.join(", ")
            )
            .into(),
            (false, false) => self.unconfirmed.map_or(
                "no vehicle has obeyed: neither plant-sim nor bridge runs; a bridge or plant-sim that is started now obeys the stop",
                Unconfirmed::text,
            )
            .into(),
        }
    }

    /// The report as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report holds only what JSON can say")
    }
}

impl std::fmt::Display for ObeyedStop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let vehicle = self.vehicle_text();
        let daemon = match (self.daemon_obeys, self.has_daemons) {
            (true, false) => "the daemon obeys",
            (true, true) => "the daemons obey",
            (false, false) => "no daemon has obeyed",
            (false, true) => "not every daemon has obeyed",
        };
        let what = if self.motors_off { "stopped" } else { "stop" };
        let under = if self.roots.is_empty() { "" } else { " under " };
        let place = format!("{under}{}", listed(&self.roots));
        write!(f, "{what}{place}: {vehicle}; {daemon}")?;
        if !self.motors_off {
            self.paths.iter().try_for_each(|path| write!(f, "\n  {path}"))?;
        } else if let Some(reason) = &self.unanswered {
            write!(f, "\ncontrol service: no answer from the daemon{reason}")?;
        }
        if self.observes_only {
            let reason = ArmingObstacle::ObservesOnly;
            return write!(f, "\n{reason}: it sends no commands, so no `arm` is needed");
        }
        write!(f, "{}", self.again)
    }
}

#[cfg(test)]
mod tests;
