//! `oqtal ctl`: operator commands to a running daemon, and the status of its instance.

use clap::Args;
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, UNCHANGED};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::topic::TELEMETRY;
use oqtal_config::{Config, InstanceOptions};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::status::InstanceStatus;
use oqtal_operator::request::{edited_note, running_bus, send, unanswered, waypoints_note};
use oqtal_operator::{
    AddressedInstance, ControlReport, CtlRequest, arm, land, namesakes, request_of, status, stop,
};
use oqtal_runtime::process::{CommonArgs, Exit, Failure, paths_of};
use oqtal_runtime::program::{print, say};

use crate::daemon_config::daemon_config;

/// Arguments of `oqtal ctl`.
#[derive(Args, Debug)]
pub struct CtlArgs {
    /// The command to the daemon
    #[arg(value_enum)]
    command: CtlRequest,
    /// Of `goto`: X Y Z in m and, if wanted, YAW in degrees; of `fly`: a trajectory; of `set`: KEY=VALUE ...; of `get`: a key, or
    /// none; of `reload`: a file; of `controller`: a law
    #[arg(value_name = "ARGUMENT", allow_negative_numbers = true)]
    arguments: Vec<String>,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl CtlArgs {
    /// Sends the command and prints the answer.
    ///
    /// # Errors
    /// No daemon answers (exit code 75), or it refuses the command (1).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let mut document = None;
        let result = self.run(&mut document);
        if let Some(answer) = document.filter(|_| self.json) {
            print(&answer)?;
        }
        result
    }

    /// Name of the command.
    pub fn name(&self) -> String {
        self.command.command().to_string()
    }

    /// Like [`CtlArgs::execute`]; `document` receives an answer as JSON, also that of a refusal.
    fn run(&self, document: &mut Option<String>) -> Result<Exit, Failure> {
        let request = request_of(self.command, &self.arguments)?.by("oqtal");
        let (instance, config) = self.target()?;
        let address =
            AddressedInstance { paths: paths_of(&instance)?, has_root: !instance.root.is_empty() };
        self.check_settings(&address)?;
        if let CtlRequest::Stop = self.command {
            return self.stop((&address, request), document);
        }
        let named = config.as_ref().filter(|_| !self.common.config.is_empty());
        let expected = named.map(Config::hash);
        let bus = self.bus(&address)?;
        let (status, (response, roots)) = match &bus {
            None => (InstanceStatus::default(), land::land(&address, request)?),
            Some(bus) => {
                self.check_waypoints(named, &address)?;
                let (response, status) = self.ask(bus, request, expected)?;
                (status, (response, Vec::new()))
            }
        };
        let lines = [status.lines(), self.notes(&address, bus.as_ref(), &response)].concat();
        let report = ControlReport::new(self.command.command(), &response, status, &address.paths)
            .under(&roots);
        let refused = report.check(&response, expected);
        let report = match &refused {
            Ok(()) => report,
            Err(failure) => report.with_error(failure),
        };
        *document = Some(report.to_json());
        self.tell_edited_files(&address);
        if refused.is_err() {
            // The processes with their configurations, if these differ.
            lines.iter().for_each(|line| say(line));
            let told = named.and_then(|config| differences(config, &address, &response));
            told.iter().for_each(|line| say(line));
        }
        refused?;
        if !self.json {
            print(&report.to_text(&lines))?;
        }
        Ok(Exit::Ok)
    }

    /// The bus of the running instance; `None` for a landing, which finds the daemon by itself.
    fn bus(&self, address: &AddressedInstance) -> Result<Option<Bus>, Failure> {
        if let CtlRequest::Land = self.command {
            return Ok(None);
        }
        address.paths.become_owner()?;
        running_bus(&address.paths).map(Some)
    }

    /// Lines below the answer: of `status` the observers, the faults that the configuration of the daemon injects, and other instances of
    /// the name.
    fn notes(
        &self,
        address: &AddressedInstance,
        bus: Option<&Bus>,
        response: &ControlResponseV1,
    ) -> Vec<String> {
        let note = self.trajectory_note(address, response);
        if !matches!(self.command, CtlRequest::Status) {
            return Vec::from_iter(note);
        }
        let config = daemon_config(&address.paths);
        let config = config.filter(|config| config.hash() == response.config_hash);
        let faults = config.and_then(|config| injected(&config));
        let observers = bus.map(observed_by);
        observers.into_iter().chain(faults).chain(namesakes(&address.paths)).collect()
    }

    /// Tells which files of the daemon were removed, or have an edit that the daemon does not use. A command that ends a flight does not wait
    /// for them; one that reads them does not need them.
    fn tell_edited_files(&self, address: &AddressedInstance) {
        let is_told = !self.command.ends_flight() && !matches!(self.command, CtlRequest::Reload);
        let note = is_told.then(|| edited_note(&address.paths)).flatten();
        note.iter().for_each(|note| say(&format!("oqtal: {note}")));
    }

    /// Note that keys of `[trajectory]` set in flight do not change the trajectory being flown; `None` otherwise.
    fn trajectory_note(
        &self,
        address: &AddressedInstance,
        response: &ControlResponseV1,
    ) -> Option<String> {
        let is_of_path = |setting: &String| setting.starts_with("trajectory.");
        let is_later = matches!(self.command, CtlRequest::Set)
            && response.answer != Answer::Refused.code()
            && response.mode == Mode::Flying.code()
            && !response.text.as_str().starts_with(UNCHANGED)
            && self.arguments.iter().any(is_of_path);
        let line = || {
            format!(
                "trajectory.height-m, take-off-s, settle-s and descent-m-s take effect with the next flight, other keys of [trajectory] with \
                 the next `oqtal ctl fly TRAJECTORY {}`",
                address.paths.flags()
            )
        };
        is_later.then(line)
    }

    /// Stops the addressed vehicle, and prints which processes obey.
    fn stop(
        &self,
        (address, request): (&AddressedInstance, ControlRequestV1),
        document: &mut Option<String>,
    ) -> Result<Exit, Failure> {
        let stop = stop::raise(address, request)?;
        *document = Some(stop.to_json());
        stop.check()?;
        if !self.json {
            print(&stop.to_string())?;
        }
        Ok(Exit::Ok)
    }

    /// Refuses a `--set` that would have no effect: only those of the instance, and of the configuration that `arm` expects, have
    /// one. A command that ends a flight is sent nevertheless.
    fn check_settings(&self, address: &AddressedInstance) -> Result<(), Failure> {
        let is_used = |text: &&String| text.trim_start().starts_with("instance.");
        let names_expected =
            matches!(self.command, CtlRequest::Arm) && !self.common.config.is_empty();
        let Some(unused) = self.common.settings.iter().find(|text| !is_used(text)) else {
            return Ok(());
        };
        if names_expected {
            return Ok(());
        }
        let message = format!(
            "ctl: --set {unused} would have no effect: `oqtal ctl set KEY=VALUE {}` changes a setting of the running daemon",
            address.paths.flags()
        );
        if self.command.ends_flight() {
            say(&format!("oqtal: warning: {message}"));
            return Ok(());
        }
        Err(Failure::new(Exit::Usage, message))
    }

    /// Refuses to arm under the configuration `named` along waypoints that were edited after the daemon had read them.
    fn check_waypoints(
        &self,
        named: Option<&Config>,
        address: &AddressedInstance,
    ) -> Result<(), Failure> {
        let flies_file = |config: &Config| config.trajectory.kind == TrajectoryKind::Waypoints;
        let is_checked = matches!(self.command, CtlRequest::Arm) && named.is_some_and(flies_file);
        match is_checked.then(|| waypoints_note(&address.paths)).flatten() {
            Some(note) => {
                let kept = "without --config the vehicle flies along the waypoints that were read";
                Err(Failure::new(Exit::Flight, format!("arm refused: {note}; {kept}")))
            }
            None => Ok(()),
        }
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

    /// Answer of the daemon, and the status of the instance if the command needs it.
    fn ask(
        &self,
        bus: &Bus,
        body: ControlRequestV1,
        expected: Option<u64>,
    ) -> Result<(ControlResponseV1, InstanceStatus), Failure> {
        let mut status = InstanceStatus::default();
        let response = match self.command {
            CtlRequest::Arm => arm::ask(bus, body, expected, &mut say, &|| false)?,
            CtlRequest::Status => {
                status = status::observe(bus)?;
                // A daemon that is not seen would not answer either.
                if status.has_daemon() { send(bus, body, expected)? } else { None }
            }
            _ => send(bus, body, expected)?,
        };
        let differs = response.is_some_and(|response| {
            response.answer == Answer::Refused.code() && names_configurations(&response)
        });
        if differs {
            status = status::observe(bus)?;
        }
        let Some(response) = response else {
            status.lines().iter().for_each(|line| say(line));
            return Err(unanswered(bus));
        };
        Ok((response, status))
    }
}

/// The faults that `config` injects, as a line of text; `None` without any.
fn injected(config: &Config) -> Option<String> {
    let faults: Vec<String> = config.fault.inject.iter().map(ToString::to_string).collect();
    (!faults.is_empty()).then(|| format!("{:<10} injected: {}", "faults", faults.join(", ")))
}

/// Settings of the daemon, as of its start, that differ from `expected`; `None` if it did not refuse for that reason, or its file
/// cannot be read.
fn differences(
    expected: &Config,
    address: &AddressedInstance,
    response: &ControlResponseV1,
) -> Option<String> {
    let is_other =
        response.cause == Cause::OtherConfig.code() && response.config_hash != expected.hash();
    let daemon = is_other.then(|| daemon_config(&address.paths)).flatten();
    let daemon = daemon.filter(|daemon| daemon.hash() == response.config_hash)?;
    let of_daemon = daemon.hashed_differences(expected);
    (!of_daemon.is_empty()).then(|| format!("the daemon was started with {}", of_daemon.join(", ")))
}

/// Whether the daemon reports that processes run with different configurations.
fn names_configurations(response: &ControlResponseV1) -> bool {
    let mut obstacles = ArmingObstacles::from_bits(response.obstacles).iter();
    obstacles.any(|obstacle| obstacle == ArmingObstacle::Configuration)
}

/// Line on the recorders, pages and monitors of the instance.
fn observed_by(bus: &Bus) -> String {
    match bus.observers(&TELEMETRY) {
        Ok(observers) if observers.is_empty() => "observers  none".to_owned(),
        Ok(observers) => format!("observers  {}", observers.join(", ")),
        Err(error) => format!("observers  unknown: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::text::LongText;

    use super::*;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        ctl: CtlArgs,
    }

    #[test]
    fn settings_that_change_nothing_are_not_said_to_take_effect_later() {
        let line: Line = clap::Parser::parse_from(["ctl", "set", "trajectory.height-m=1"]);
        let paths = oqtal_bus::paths::InstancePaths::new("a", None).unwrap();
        let address = AddressedInstance { paths, has_root: false };
        let is_noted = |text| {
            let (mode, text) = (Mode::Flying.code(), LongText::new(text));
            let flying = ControlResponseV1 { mode, text, ..ControlResponseV1::default() };
            line.ctl.trajectory_note(&address, &flying).is_some()
        };
        assert_eq!([is_noted("trajectory.height-m=1"), is_noted(UNCHANGED)], [true, false]);
    }

    #[test]
    fn injected_faults_are_named() {
        let mut config = Config::default();
        assert_eq!(injected(&config), None);
        config.fault.inject = vec!["pose:off@1".parse().unwrap()];
        assert_eq!(injected(&config).unwrap(), "faults     injected: pose:off@1");
    }
}
