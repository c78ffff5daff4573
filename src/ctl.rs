//! `oqtal ctl`: operator commands to a running daemon, and the status of its instance.

mod arm;
mod change;
mod land;
mod reach;
mod request;
mod status;
mod stop;

use clap::{Args, ValueEnum};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::paths::InstancePaths;
use oqtal_config::{Config, InstanceOptions};
use oqtal_runtime::process::{CommonArgs, Exit, Failure, paths_of};
use oqtal_runtime::program::{print, say};
use serde::Serialize;

pub use change::CtlRequest;
use oqtal_observe::status::{InstanceStatus, ProcessHealth, VehicleStatus, word};
use reach::AddressedInstance;
use request::{request, running_bus, send, silent};

/// Arguments of `oqtal ctl`.
#[derive(Args, Debug)]
pub struct CtlArgs {
    /// The command to the daemon
    #[arg(value_enum)]
    command: CtlRequest,
    /// Of `goto`: X Y Z in m and, if wanted, YAW in degrees; of `fly`: a trajectory; of `set`: KEY=VALUE ...; of `get`: a key; of
    /// `reload`: a file; of `controller`: a law
    #[arg(value_name = "ARGUMENT", allow_negative_numbers = true)]
    arguments: Vec<String>,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// Answer of the daemon, as printed.
#[derive(Debug, Serialize)]
struct ControlReport {
    command: String,
    answer: String,
    /// Effect of the command as text.
    effect: String,
    mode: String,
    state: String,
    cause: String,
    /// The settings that took effect, the requested value, or the reason of a refusal.
    #[serde(skip_serializing_if = "String::is_empty")]
    text: String,
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
    /// Estimated position \[m, world\].
    #[serde(skip_serializing_if = "Option::is_none")]
    position_m: Option<[f64; 3]>,
}

impl CtlArgs {
    /// Sends the command and prints the answer.
    ///
    /// # Errors
    /// No daemon answers (exit code 75), or it refuses the command (1).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let request = change::request_of(self.command, &self.arguments)?;
        let (instance, config) = self.target()?;
        let address =
            AddressedInstance { paths: paths_of(&instance)?, has_root: !instance.root.is_empty() };
        if let CtlRequest::Stop = self.command {
            return stop::execute(&address, self.json);
        }
        let named = config.as_ref().filter(|_| !self.common.config.is_empty());
        let expected = named.map(Config::hash);
        let (response, status) = match self.command {
            CtlRequest::Land => (Some(land::land(&address)?), InstanceStatus::default()),
            _ => {
                address.paths.become_owner()?;
                self.ask(&running_bus(&address.paths)?, request, expected)?
            }
        };
        let Some(response) = response else {
            status.lines().iter().for_each(|line| say(line));
            return Err(silent(&instance.name));
        };
        let lines = status.lines();
        let report = ControlReport::new(self.command.command(), &response, status);
        let refused = report.check(&response, expected);
        if refused.is_err() {
            // The processes with their configurations, if these differ.
            lines.iter().for_each(|line| say(line));
        }
        refused?;
        print(&if self.json { report.to_json() } else { report.to_text(&lines) })?;
        Ok(Exit::Ok)
    }

    /// Instance and configuration. A flight must be ended even with an invalid configuration: a command that ends one needs only
    /// the instance, and errors are only reported.
    fn target(&self) -> Result<(InstanceOptions, Option<Config>), Failure> {
        let (file, ends_flight) = (&self.common.config, self.command.ends_flight());
        let loaded = self.common.settings().and_then(|settings| Config::load(file, &settings));
        match loaded {
            Ok(config) => Ok((config.instance.clone(), Some(config))),
            Err(error) if ends_flight => {
                let (instance, errors) =
                    InstanceOptions::salvage(file, &self.common.usable_settings());
                let all = std::iter::once(&error).chain(errors.iter().filter(|e| **e != error));
                all.for_each(|error| say(&format!("oqtal: warning: {error}")));
                say(&format!(
                    "oqtal: the configuration has errors; `{}` is sent to instance `{}` nevertheless",
                    self.command.command(),
                    instance.name
                ));
                Ok((instance, None))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Answer of the daemon, `None` if there is none, and the status of the instance if the command needs it.
    fn ask(
        &self,
        bus: &Bus,
        body: ControlRequestV1,
        expected: Option<u64>,
    ) -> Result<(Option<ControlResponseV1>, InstanceStatus), BusError> {
        let response = match self.command {
            CtlRequest::Arm => arm::ask(bus, expected)?,
            _ => send(bus, body, expected)?,
        };
        let differs = response.is_some_and(|response| {
            response.answer == Answer::Refused.code() && names_configurations(&response)
        });
        let status = match self.command {
            CtlRequest::Status => status::observe(bus)?,
            _ if differs => status::observe(bus)?,
            _ => InstanceStatus::default(),
        };
        Ok((response, status))
    }
}

/// Whether the daemon reports that processes run with different configurations.
fn names_configurations(response: &ControlResponseV1) -> bool {
    let mut obstacles = ArmingObstacles::from_bits(response.obstacles).iter();
    obstacles.any(|obstacle| obstacle == ArmingObstacle::Configuration)
}

/// Effect of an accepted command, from the mode after it.
fn effect(command: OperatorCommand, mode: Option<Mode>, answer: &str) -> String {
    match (command, mode) {
        (OperatorCommand::Arm, Some(Mode::Flying)) => "armed, the flight has begun".to_owned(),
        (OperatorCommand::Land, Some(Mode::Landing)) => {
            "landing where it is; motors off on the floor".to_owned()
        }
        (OperatorCommand::Land | OperatorCommand::Disarm, Some(Mode::Disarmed)) => {
            format!("{command}: motors off")
        }
        _ => format!("{command}: {answer}"),
    }
}

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

/// Executes a request like `oqtal ctl`, on the calling thread, made by the author with whom `sign` signs it; returns the answer as
/// text. `expected`: hash of the configuration that the daemon must run with.
///
/// # Errors
/// No daemon answers, or it refuses; the motors are not known to be off after a stop; the arguments are not those of the command.
pub fn execute(
    paths: &InstancePaths,
    (command, arguments): (CtlRequest, &[String]),
    expected: Option<u64>,
    sign: impl FnOnce(ControlRequestV1) -> ControlRequestV1,
) -> Result<String, Failure> {
    let body = sign(change::request_of(command, arguments)?.by("oqtal"));
    let response = match command {
        CtlRequest::Stop => {
            let stop = stop::raise(&here(paths))?;
            return match stop.motors_off {
                true => Ok(stop.to_string()),
                false => Err(Failure::new(Exit::Flight, stop.to_string())),
            };
        }
        CtlRequest::Land => land::land(&here(paths))?,
        _ => request::send_signed(&running_bus(paths)?, body, expected)?
            .ok_or_else(|| silent(&paths.instance))?,
    };
    let report = ControlReport::new(command.command(), &response, InstanceStatus::default());
    report.check(&response, expected)?;
    Ok(report.to_text(&[]))
}

/// Ends a flight with `command`, a landing or a stop; returns whether the daemon or the vehicle obeys.
pub fn end_flight(paths: &InstancePaths, command: OperatorCommand) -> bool {
    if command == OperatorCommand::Stop {
        let stopped = stop::raise(&here(paths));
        return stopped.is_ok_and(|stop| stop.vehicle_obeys || stop.daemon_obeys);
    }
    execute(paths, (CtlRequest::Land, &[]), None, |request| request).is_ok()
}

/// Executes `line`, written as after `oqtal ctl`; returns the answer as one line.
pub fn execute_line(paths: &InstancePaths, line: &str) -> String {
    let mut words = line.split_whitespace().map(str::to_owned);
    let command = words.next().unwrap_or_default();
    let known = CtlRequest::from_str(&command, false);
    let result = known
        .map_err(|_| Failure::new(Exit::Usage, format!("`{command}` is not a request")))
        .and_then(|known| execute(paths, (known, &Vec::from_iter(words)), None, |request| request));
    let text = result.unwrap_or_else(|failure| failure.message);
    text.lines().map(str::trim).collect::<Vec<_>>().join("; ")
}

/// AddressedInstance of the instance that the calling process observes.
fn here(paths: &InstancePaths) -> AddressedInstance {
    AddressedInstance { paths: paths.clone(), has_root: true }
}

impl ControlReport {
    fn new(command: OperatorCommand, response: &ControlResponseV1, status: InstanceStatus) -> Self {
        let config_agrees = status.config_agrees();
        let InstanceStatus { processes, vehicle, position_m } = status;
        let answer = word(Answer::from_code(response.answer));
        Self {
            command: command.to_string(),
            effect: effect(command, Mode::from_code(response.mode), &answer),
            answer,
            mode: word(Mode::from_code(response.mode)),
            state: word(SafetyState::from_code(response.state)),
            cause: word(Cause::from_code(response.cause)),
            text: response.text.as_str().to_owned(),
            obstacles: ArmingObstacles::from_bits(response.obstacles)
                .iter()
                .map(|obstacle| obstacle.to_string())
                .collect(),
            processes,
            config_agrees,
            vehicle,
            position_m,
        }
    }

    /// Fails if the daemon refused the command.
    fn check(&self, response: &ControlResponseV1, expected: Option<u64>) -> Result<(), Failure> {
        if response.answer != Answer::Refused.code() {
            return Ok(());
        }
        let Self { command, cause, mode, obstacles, text, .. } = self;
        let listed = obstacles.join("; ");
        let reasons = match (obstacles.is_empty(), cause.as_str()) {
            (false, _) => &listed,
            (true, "") => "the flight did not begin",
            (true, cause) => cause,
        };
        let mut message = format!("{command} refused: {reasons} (daemon is {mode})");
        if !text.is_empty() {
            message += &format!(": {text}");
        }
        if response.cause == Cause::WrongMode.code()
            && *command == OperatorCommand::Disarm.to_string()
        {
            message += "; `land` or `stop` ends a flight";
        }
        if response.cause == Cause::OtherConfig.code() {
            message += &format!(
                "; the daemon runs with {:016x}, expected is {:016x}: compare both with `oqtal check`",
                response.config_hash,
                expected.unwrap_or(0)
            );
        }
        Err(Failure::new(Exit::Flight, message))
    }

    fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report is plain JSON")
    }

    /// The answer and the lines of the status as text.
    fn to_text(&self, lines: &[String]) -> String {
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
        first.chain(against).chain(lines.iter().cloned()).collect::<Vec<_>>().join("\n")
    }
}
