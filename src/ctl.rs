//! `oqtal ctl`: speaks to a running daemon, and looks how the processes are.

mod status;

use clap::{Args, ValueEnum};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths};
use oqtal_runtime::program::{print, say};
use serde::Serialize;

use status::{Overview, ProcessHealth, Vehicle};

/// How long a running daemon may take to answer.
const PATIENCE: Span = Span::from_millis(2000);

/// What to ask.
#[derive(Args, Debug)]
pub struct CtlArgs {
    /// What the daemon is asked
    #[arg(value_enum)]
    command: Request,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// What an operator can ask.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Request {
    /// How it is, and how the processes are
    Status,
    /// Arm and fly the configured trajectory
    Arm,
    /// Motors off, on the ground
    Disarm,
    /// Land where it is
    Land,
    /// Motors off now; latched until armed again
    Stop,
}

impl Request {
    fn command(self) -> OperatorCommand {
        match self {
            Self::Status => OperatorCommand::Status,
            Self::Arm => OperatorCommand::Arm,
            Self::Disarm => OperatorCommand::Disarm,
            Self::Land => OperatorCommand::Land,
            Self::Stop => OperatorCommand::Stop,
        }
    }
}

/// The answer, as it is printed.
#[derive(Debug, Serialize)]
struct Report {
    command: String,
    answer: String,
    mode: String,
    state: String,
    cause: String,
    /// With `status` only, like all below.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    processes: Vec<ProcessHealth>,
    /// Whether all processes that are heard run with one configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    config_agrees: Option<bool>,
    /// If somebody speaks for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle: Option<Vehicle>,
    /// Where the daemon believes the vehicle is \[m, world\].
    #[serde(skip_serializing_if = "Option::is_none")]
    position_m: Option<[f64; 3]>,
}

impl CtlArgs {
    /// Asks, and prints the answer.
    ///
    /// # Errors
    /// No daemon answers (exit code 75), or it refuses (exit code 1).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.common.config.as_deref(), &self.common.settings()?)?;
        let place = instance_paths(&config)?;
        place.become_owner()?;
        let bus = Bus::open(&place)?;
        let asked = self.ask(&bus);
        drop(bus);
        let (response, heard) = asked?;
        let Some(response) = response else {
            for line in heard.lines() {
                say(&line);
            }
            let instance = &config.instance.name;
            let message = format!(
                "no daemon answers on instance `{instance}`; start one with `oqtal daemon run --instance {instance}`"
            );
            return Err(Failure::new(Exit::Peer, message));
        };
        let lines = heard.lines();
        let report = Report::new(self.command.command(), &response, heard);
        if response.answer == Answer::Refused.code() {
            let Report { command, cause, mode, .. } = report;
            let message = format!("{command} refused: {cause} (daemon is {mode})");
            return Err(Failure::new(Exit::Flight, message));
        }
        print(&if self.json { report.to_json() } else { report.to_text(&lines) })?;
        Ok(Exit::Ok)
    }

    /// What the daemon answers, `None` if there is none; with `status` also how processes and vehicle are.
    fn ask(&self, bus: &Bus) -> Result<(Option<ControlResponseV1>, Overview), BusError> {
        let request = ControlRequestV1 { command: self.command.command().code() };
        let response = bus.control_client()?.ask(request, PATIENCE)?;
        let heard = match self.command {
            Request::Status => status::listen(bus)?,
            _ => Overview::default(),
        };
        Ok((response, heard))
    }
}

impl Report {
    fn new(command: OperatorCommand, response: &ControlResponseV1, heard: Overview) -> Self {
        let config_agrees = heard.config_agrees();
        let Overview { processes, vehicle, position_m } = heard;
        Self {
            command: command.to_string(),
            answer: word(Answer::from_code(response.answer)),
            mode: word(Mode::from_code(response.mode)),
            state: word(SafetyState::from_code(response.state)),
            cause: word(Cause::from_code(response.cause)),
            processes,
            config_agrees,
            vehicle,
            position_m,
        }
    }

    fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report holds only what JSON can say")
    }

    /// The answer, and what else was heard.
    fn to_text(&self, lines: &[String]) -> String {
        let Self { command, answer, mode, state, cause, .. } = self;
        let because = if cause.is_empty() { String::new() } else { format!(" ({cause})") };
        let first = format!("{command}: {answer}; {mode}, {state}{because}");
        [&[first], lines].concat().join("\n")
    }
}

/// A code in words; nothing for one that no version of ours sends.
fn word(code: Option<impl ToString>) -> String {
    code.map_or_else(String::new, |code| code.to_string())
}
