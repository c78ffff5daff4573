//! `oqtal ctl stop`: stops the vehicle in two independent ways, and reports which processes obey.
//!
//! The stop is first raised in shared memory, where the process of the vehicle and the daemon read it in their next turn without
//! a lock or an answer. The daemon is then also requested to stop over the control service.

use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::stop::{StopReport, StopSwitch};
use oqtal_bus::time::{Span, Time};
use oqtal_observe::status::word;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde::Serialize;

/// Time after which the report is printed.
const REPORT_TIMEOUT: Span = Span::from_millis(950);
/// Period at which obedience is checked.
const CHECK_PERIOD: Duration = Duration::from_millis(2);

/// Report of a stop: the processes that have obeyed.
#[derive(Debug, Serialize)]
pub struct ObeyedStop {
    command: &'static str,
    /// Whether commands are withheld from the vehicle.
    vehicle_obeys: bool,
    /// Whether the vehicle's motors are known to be off.
    pub motors_off: bool,
    /// Whether the daemon commands "disarmed".
    daemon_obeys: bool,
    /// Mode and state of the daemon; empty if it did not answer in time.
    mode: String,
    state: String,
}

/// Raises a stop on the instance at `paths`, and prints which processes obey.
///
/// # Errors
/// The vehicle obeys, but has not reported that its motors are off (exit code 1); no process of a vehicle obeys (75); the
/// instance belongs to another user (77).
pub fn execute(paths: &InstancePaths, json: bool) -> Result<Exit, Failure> {
    conclude(&raise(paths)?, json)
}

/// Raises a stop on the instance at `paths`, and returns which processes obey within a second.
///
/// # Errors
/// No process runs (75), or the instance belongs to another user (77).
pub fn raise(paths: &InstancePaths) -> Result<ObeyedStop, Failure> {
    let give_up = Time::now() + REPORT_TIMEOUT;
    let Some(switch) = StopSwitch::existing(paths)? else {
        let message = format!(
            "stop: no process of oqtal runs on instance `{}`: nothing to stop",
            paths.instance
        );
        return Err(Failure::new(Exit::Peer, message));
    };
    let number = switch.raise();
    let answer = ask_daemon(paths.clone());
    let mut response = None;
    let mut report = switch.report(number);
    while Time::now() < give_up && !(report.motors_off && report.daemon_obeys && response.is_some())
    {
        response = response.or_else(|| answer.recv_timeout(CHECK_PERIOD).ok());
        if response.is_some() {
            std::thread::sleep(CHECK_PERIOD);
        }
        report = switch.report(number);
    }
    Ok(ObeyedStop::new(report, response.as_ref()))
}

/// Sends the request on a separate thread, which is abandoned after the time-out: a suspended process may hold the lock of the
/// instance.
fn ask_daemon(paths: InstancePaths) -> Receiver<ControlResponseV1> {
    let (answers, answer) = channel();
    std::thread::spawn(move || {
        let request = ControlRequestV1::of(OperatorCommand::Stop);
        let asked = Bus::open(&paths)
            .and_then(|bus| bus.control_client()?.ask(request, REPORT_TIMEOUT.scaled(0.8)));
        if let Ok(Some(response)) = asked {
            // Fails after the time-out, when the receiver has been dropped.
            let _ = answers.send(response);
        }
    });
    answer
}

/// Prints which processes obey; succeeds if the motors are known to be off.
fn conclude(stop: &ObeyedStop, json: bool) -> Result<Exit, Failure> {
    if json {
        print(&serde_json::to_string_pretty(stop).expect("a report holds only what JSON can say"))?;
    }
    match stop {
        ObeyedStop { motors_off: true, .. } => {
            if !json {
                print(&stop.to_string())?;
            }
            Ok(Exit::Ok)
        }
        ObeyedStop { vehicle_obeys: true, .. } => Err(Failure::new(Exit::Flight, stop.to_string())),
        _ => Err(Failure::new(Exit::Peer, stop.to_string())),
    }
}

impl ObeyedStop {
    fn new(report: StopReport, response: Option<&ControlResponseV1>) -> Self {
        let StopReport { vehicle_obeys, motors_off, daemon_obeys } = report;
        Self {
            command: "stop",
            vehicle_obeys,
            motors_off,
            daemon_obeys,
            mode: word(response.and_then(|response| Mode::from_code(response.mode))),
            state: word(response.and_then(|response| SafetyState::from_code(response.state))),
        }
    }
}

impl std::fmt::Display for ObeyedStop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let vehicle = match (self.vehicle_obeys, self.motors_off) {
            (_, true) => "motors off until `arm`",
            (true, false) => {
                "no command reaches the vehicle any more, but it has not reported that its motors are off"
            }
            (false, false) => {
                "no vehicle has obeyed: neither plant-sim nor bridge runs, or it hangs, or has no port, or virtual time \
                 stands still; the stop stays raised until it is obeyed, or until every process of the instance has ended"
            }
        };
        let daemon = if self.daemon_obeys { "the daemon obeys" } else { "no daemon has obeyed" };
        let what = if self.motors_off { "stopped" } else { "stop" };
        write!(f, "{what}: {vehicle}; {daemon}")
    }
}
