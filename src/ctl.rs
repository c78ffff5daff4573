//! `oqtal ctl`: speaks to a running daemon.

use clap::{Args, ValueEnum};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, SafetyState, Verb};
use oqtal_bus::config::Config;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::process::{CommonArgs, Exit, Failure, place_of};
use oqtal_bus::time::Span;

/// How long a running daemon may take to answer.
const PATIENCE: Span = Span::from_millis(2000);

/// What to ask.
#[derive(Args, Debug)]
pub struct CtlArgs {
    /// What the daemon is asked
    #[arg(value_enum)]
    verb: Request,
    #[command(flatten)]
    common: CommonArgs,
}

/// What an operator can ask.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Request {
    /// How it is
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

impl CtlArgs {
    /// Asks, and prints the answer.
    ///
    /// # Errors
    /// No daemon answers (exit code 75), or it refuses (exit code 1).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.common.config.as_deref(), &self.common.settings()?)?;
        let bus = Bus::open(&place_of(&config)?)?;
        let verb = match self.verb {
            Request::Status => Verb::Status,
            Request::Arm => Verb::Arm,
            Request::Disarm => Verb::Disarm,
            Request::Land => Verb::Land,
            Request::Stop => Verb::Stop,
        };
        let request = ControlRequestV1 { verb: verb.code() };
        let answer = bus.control_client().and_then(|client| client.ask(request, PATIENCE));
        bus.leave();
        let answer = answer?;
        let Some(response) = answer else {
            let instance = &config.instance.name;
            let message = format!(
                "no daemon answers on instance `{instance}`; start one with `oqtal daemon run --instance {instance}`"
            );
            return Err(Failure::new(Exit::Peer, message));
        };
        report(verb, &response)
    }
}

fn report(verb: Verb, response: &ControlResponseV1) -> Result<Exit, Failure> {
    let mode = Mode::from_code(response.mode).map_or_else(String::new, |mode| mode.to_string());
    let state = SafetyState::from_code(response.state).map_or_else(String::new, |s| s.to_string());
    let cause = Cause::from_code(response.cause).map_or_else(String::new, |c| c.to_string());
    if response.answer == Answer::Refused.code() {
        return Err(Failure::new(
            Exit::Flight,
            format!("{verb} refused: {cause} (daemon is {mode})"),
        ));
    }
    let answer = Answer::from_code(response.answer).map_or_else(String::new, |a| a.to_string());
    let because = if cause.is_empty() { String::new() } else { format!(" ({cause})") };
    println!("{verb}: {answer}; {mode}, {state}{because}");
    Ok(Exit::Ok)
}
