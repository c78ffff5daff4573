//! The daemon's answer to a command, as text and as JSON.

use std::path::PathBuf;

use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::ControlResponseV1;
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::paths::InstancePaths;
use oqtal_observe::status::{InstanceStatus, ProcessHealth, VehicleStatus, word};
use oqtal_runtime::process::{Exit, Failure};
use serde::Serialize;

/// Answer of the daemon, as printed.
#[derive(Debug, Serialize)]
pub struct ControlReport {
    command: String,
    answer: String,
    /// Effect of the command as text.
    effect: String,
    mode: String,
    state: String,
    cause: String,
    /// The settings that took effect, the requested value, or the reason of a refusal; of `arm` also that no external law is
    /// connected.
    #[serde(skip_serializing_if = "String::is_empty")]
    text: String,
    /// Message of a refusal; empty without one.
    #[serde(skip_serializing_if = "String::is_empty")]
    error: String,
    /// Obstacles to a take-off; empty in flight.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    obstacles: Vec<String>,
    /// Health of the processes; set, like the fields below, with `status` only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    processes: Vec<ProcessHealth>,
    /// Whether all observed processes run with one configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    config_agrees: Option<bool>,
    /// State of the vehicle; absent if no process publishes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle: Option<VehicleStatus>,
    /// Estimated position \[m, world\]; absent if the last pose is older than a second.
    #[serde(skip_serializing_if = "Option::is_none")]
    position_m: Option<[f64; 3]>,
    /// Whether an operator's stop is in force that the vehicle's process does not obey yet.
    awaits_stop: bool,
    /// Remedy of the obstacles of a simulated vehicle.
    #[serde(skip)]
    put_back: Option<&'static str>,
    /// Flags of a command that addresses the same instance.
    #[serde(skip)]
    place: String,
}

impl ControlReport {
    /// The answer `response` to `command` on the instance at `paths`; its `status` if the command shows it.
    pub fn new(
        command: OperatorCommand,
        response: &ControlResponseV1,
        status: InstanceStatus,
        paths: &InstancePaths,
    ) -> Self {
        let config_agrees = status.config_agrees();
        let position_m = status.position_m();
        let InstanceStatus { processes, vehicle, awaits_stop, .. } = status;
        let answer = word(Answer::from_code(response.answer));
        let obstacles = ArmingObstacles::from_bits(response.obstacles);
        let is_simulated = vehicle.as_ref().is_some_and(VehicleStatus::is_simulated);
        Self {
            command: command.to_string(),
            effect: match response.answer == Answer::Refused.code() {
                true => format!("{command}: {answer}"),
                false => effect(command, response, &answer),
            },
            answer,
            mode: word(Mode::from_code(response.mode)),
            state: word(SafetyState::from_code(response.state)),
            cause: word(Cause::from_code(response.cause)),
            text: response.text.as_str().to_owned(),
            error: String::new(),
            obstacles: obstacles.iter().map(|obstacle| obstacle.to_string()).collect(),
            put_back: put_back(obstacles).filter(|_| is_simulated),
            processes,
            config_agrees,
            vehicle,
            position_m,
            awaits_stop,
            place: paths.flags(),
        }
    }

    /// This report, of a command that was sent to daemons under several `roots`; the effect is that of a daemon that accepted it.
    pub fn under(mut self, roots: &[PathBuf]) -> Self {
        if !roots.is_empty() {
            self.effect = format!("requested under {}; {}", listed(roots), self.effect);
        }
        self
    }

    /// Fails if the daemon refused the command. `expected`: hash of the configuration that it must run with.
    ///
    /// # Errors
    /// The daemon refused the command (exit code 1).
    pub fn check(
        &self,
        response: &ControlResponseV1,
        expected: Option<u64>,
    ) -> Result<(), Failure> {
        if response.answer != Answer::Refused.code() {
            return Ok(());
        }
        let Self { command, cause, mode, obstacles, text, place, .. } = self;
        let listed = obstacles.join("; ");
        let has_no_flight = *command == OperatorCommand::Land.to_string()
            && *mode == Mode::Disarmed.to_string()
            && response.cause != Cause::ObservesOnly.code();
        // Causes that lie in the request itself: the obstacles to a take-off are then not the reason.
        let is_of_request = matches!(
            Cause::from_code(response.cause),
            Some(Cause::OtherConfig | Cause::Expired | Cause::CalledOff)
        );
        let is_take_off = *command == OperatorCommand::Arm.to_string();
        let reasons = match (obstacles.is_empty(), cause.as_str()) {
            _ if has_no_flight && is_silent(response) => &format!(
                "the motors are commanded off, and the vehicle does not answer; `oqtal ctl stop {place}` tries every path to it"
            ),
            _ if has_no_flight && is_taken(response) => NOT_OURS,
            _ if has_no_flight => "there is no flight",
            (false, _) if is_take_off && !is_of_request => &listed,
            (false, "") => &listed,
            (true, "") => "the flight did not begin",
            (_, cause) => cause,
        };
        let mut message = format!("{command} refused: {reasons} (daemon is {mode})");
        if !text.is_empty() {
            message += &format!(": {text}");
        }
        message += &self.remedy(response, expected);
        Err(Failure::new(Exit::Flight, message))
    }

    /// This report with the message of `failure`.
    pub fn with_error(mut self, failure: &Failure) -> Self {
        self.error.clone_from(&failure.message);
        self
    }

    /// Remedy of a refusal; empty if the cause is sufficient.
    fn remedy(&self, response: &ControlResponseV1, expected: Option<u64>) -> String {
        use OperatorCommand::{Arm, Disarm, Goto, Hover, Resume, Trajectory};
        let is_one_of = |commands: &[OperatorCommand]| {
            commands.iter().any(|command| command.to_string() == self.command)
        };
        let (place, is_course) = (&self.place, is_one_of(&[Goto, Trajectory, Hover]));
        let remedy = match Cause::from_code(response.cause) {
            Some(Cause::WrongMode) if is_one_of(&[Disarm]) => {
                &format!("`oqtal ctl land {place}` or `oqtal ctl stop {place}` ends a flight")
            }
            Some(Cause::WrongMode) if is_one_of(&[Arm]) => &format!(
                "a flight has already begun, perhaps at another operator's request; `oqtal ctl status {place}` shows it"
            ),
            Some(Cause::WrongMode) if is_one_of(&[Resume]) => {
                "`resume` returns from the fallback law to `control.controller`; it needs a flight and a law in `control.fallback`"
            }
            Some(Cause::WrongMode) if is_course && response.mode == Mode::Disarmed.code() => {
                &format!("`oqtal ctl arm {place}` begins a flight")
            }
            Some(Cause::Fence) if is_course && response.state == SafetyState::Hold.code() => {
                &format!(
                    "the fence holds the vehicle; repeat it once `oqtal ctl status {place}` no longer says Hold, or `oqtal ctl land {place}`"
                )
            }
            Some(Cause::NoLaw) => "start the law's program, then repeat `resume`",
            Some(Cause::NearFloor) => &format!(
                "choose a point at least 0.1 m above the floor; to land, use `oqtal ctl land {place}`"
            ),
            Some(Cause::ObservesOnly) => "to fly, start the daemon without these settings",
            Some(Cause::TakeOff) => "repeat it once the vehicle has taken off",
            Some(Cause::OtherConfig) => &other_config(response, expected, place),
            _ if is_one_of(&[Arm]) && needs_status(response) => {
                &format!("`oqtal ctl status {place}` shows the processes")
            }
            _ => return String::new(),
        };
        format!("; {remedy}")
    }

    /// The report as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report is plain JSON")
    }

    /// The answer and the lines of the status as text.
    pub fn to_text(&self, lines: &[String]) -> String {
        let Self { effect, mode, state, cause, text, .. } = self;
        if self.command == OperatorCommand::Get.to_string() {
            return text.clone();
        }
        let because = if cause.is_empty() { String::new() } else { format!(" ({cause})") };
        let first = match self.command == OperatorCommand::Status.to_string() {
            true => format!("daemon: {mode}, {state}{because}"),
            false => format!("{effect}; {mode}, {state}{because}"),
        };
        let first = [first].into_iter().chain(text.lines().map(|line| format!("  {line}")));
        let against = self.obstacles.iter().map(|obstacle| format!("no take-off: {obstacle}"));
        let against = against.chain(self.put_back.map(|remedy| format!("  {remedy}")));
        first.chain(against).chain(lines.iter().cloned()).collect::<Vec<_>>().join("\n")
    }
}

/// Paths of `roots` as text.
pub(crate) fn listed(roots: &[PathBuf]) -> String {
    roots.iter().map(|root| root.display().to_string()).collect::<Vec<_>>().join(" and ")
}

/// Remedy of a request under another configuration than the `expected` one.
fn other_config(response: &ControlResponseV1, expected: Option<u64>, place: &str) -> String {
    match expected {
        Some(hash) if hash != response.config_hash => format!(
            "the configuration hash of the daemon is {:016x}, that of the file is {hash:016x} (`oqtal check FILE` prints it)",
            response.config_hash
        ),
        _ => format!(
            "`oqtal ctl undo {place}` takes the last change back, `oqtal ctl arm {place}` without --config flies with the changed settings"
        ),
    }
}

/// Whether a process of the instance is missing, or has another configuration.
fn needs_status(response: &ControlResponseV1) -> bool {
    use ArmingObstacle::{Configuration, NoPoses, VehicleSilent};
    let obstacles = ArmingObstacles::from_bits(response.obstacles);
    [Configuration, NoPoses, VehicleSilent].into_iter().any(|obstacle| obstacles.contains(obstacle))
}

/// Remedy of obstacles that a simulated vehicle has where it lies; `None` if there are none.
pub(crate) fn put_back(obstacles: ArmingObstacles) -> Option<&'static str> {
    use ArmingObstacle::{OffFloor, OutsideFence, PathOutsideFence, Tilted};
    let lies_badly = [Tilted, OffFloor, OutsideFence, PathOutsideFence];
    lies_badly.into_iter().any(|obstacle| obstacles.contains(obstacle)).then_some(
        "a restart of oqtal plant-sim puts the simulated vehicle back, upright and at its starting point",
    )
}

/// Whether it is unknown what the vehicle does.
fn is_silent(response: &ControlResponseV1) -> bool {
    ArmingObstacles::from_bits(response.obstacles).contains(ArmingObstacle::VehicleSilent)
}

/// Answer while another has control of the vehicle.
const NOT_OURS: &str = "a pilot or the vehicle itself has control, so no command is sent to the vehicle; only the remote control lands it or stops its motors";

/// Whether a pilot or the vehicle itself has control.
fn is_taken(response: &ControlResponseV1) -> bool {
    ArmingObstacles::from_bits(response.obstacles).contains(ArmingObstacle::ControlTaken)
}

/// Effect of an accepted command, from the mode after it.
fn effect(command: OperatorCommand, response: &ControlResponseV1, answer: &str) -> String {
    match (command, Mode::from_code(response.mode)) {
        (OperatorCommand::Arm, Some(Mode::Flying)) => "armed, the flight has begun".to_owned(),
        (OperatorCommand::Land, Some(Mode::Landing)) => {
            "landing where it is; motors off on the floor".to_owned()
        }
        (OperatorCommand::Land, Some(Mode::Disarmed)) if is_silent(response) => {
            "the flight is called off; motors commanded off, the vehicle does not answer".to_owned()
        }
        (OperatorCommand::Land | OperatorCommand::Disarm, Some(Mode::Disarmed))
            if is_taken(response) =>
        {
            format!("{command}: {NOT_OURS}")
        }
        (OperatorCommand::Land, Some(Mode::Disarmed)) => "the flight is called off".to_owned(),
        (OperatorCommand::Disarm, Some(Mode::Disarmed)) if is_silent(response) => {
            "disarm: motors commanded off, the vehicle does not answer".to_owned()
        }
        (OperatorCommand::Disarm, Some(Mode::Disarmed)) => {
            "disarm: motors commanded off, a flight that has not begun is called off".to_owned()
        }
        // The loop follows the new course; it may not have confirmed it yet.
        (OperatorCommand::Goto | OperatorCommand::Trajectory | OperatorCommand::Hover, _) => {
            format!("{command}: on its way")
        }
        _ => format!("{command}: {answer}"),
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::message::VehicleV1;

    use super::*;

    #[test]
    fn f57_a_vehicle_that_another_controls_is_not_said_to_be_commanded_off_or_on_the_floor() {
        let obstacles = ArmingObstacles::default().with(ArmingObstacle::ControlTaken, true).bits();
        let paths = InstancePaths::new("a", None).unwrap();
        let said = |command, answer: Answer, cause: Cause| {
            let response = ControlResponseV1 {
                answer: answer.code(),
                mode: Mode::Disarmed.code(),
                cause: cause.code(),
                obstacles,
                ..ControlResponseV1::default()
            };
            let report = ControlReport::new(command, &response, InstanceStatus::default(), &paths);
            let checked = report.check(&response, None);
            checked.map_or_else(|failure| failure.message, |()| report.to_text(&[]))
        };
        let disarm = said(OperatorCommand::Disarm, Answer::Done, Cause::None);
        let land = said(OperatorCommand::Land, Answer::Refused, Cause::WrongMode);
        for text in [disarm, land] {
            assert!(text.contains("only the remote control lands it"), "{text}");
            assert!(!text.contains("off;") && !text.contains("no flight"), "{text}");
        }
    }

    #[test]
    fn the_second_of_two_who_arm_is_told_that_a_flight_was_begun() {
        let (answer, mode) = (Answer::Refused.code(), Mode::Flying.code());
        let cause = Cause::WrongMode.code();
        let response = ControlResponseV1 { answer, mode, cause, ..ControlResponseV1::default() };
        let paths = InstancePaths::new("a", None).unwrap();
        let status = InstanceStatus::default();
        let report = ControlReport::new(OperatorCommand::Arm, &response, status, &paths);
        let message = report.check(&response, None).unwrap_err().message;
        assert!(message.contains("a flight has already begun"), "{message}");
    }

    #[test]
    fn a_restart_of_the_simulator_is_a_remedy_for_a_simulated_vehicle_only() {
        let obstacles = ArmingObstacles::default().with(ArmingObstacle::Tilted, true).bits();
        let response = ControlResponseV1 { obstacles, ..ControlResponseV1::default() };
        let paths = InstancePaths::new("a", None).unwrap();
        for simulated in [0, 1] {
            let vehicle = VehicleStatus::new(&VehicleV1 { simulated, ..VehicleV1::default() });
            let status = InstanceStatus { vehicle: Some(vehicle), ..InstanceStatus::default() };
            let report = ControlReport::new(OperatorCommand::Status, &response, status, &paths);
            let text = report.to_text(&[]);
            assert!(text.contains("no take-off: the vehicle is tilted"), "{text}");
            assert_eq!(text.contains("plant-sim"), simulated == 1, "{text}");
        }
    }
}
