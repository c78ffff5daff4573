//! The commands of an operator, and their requests to the daemon.

use std::path::Path;

use clap::ValueEnum;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::text::LongText;
use oqtal_runtime::process::{Exit, Failure};

/// A command of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CtlRequest {
    /// Show the state of the daemon, the processes and the vehicle
    Status,
    /// Start the motors and fly the configured trajectory; refused unless the vehicle is ready
    Arm,
    /// Call off a flight that has not begun; refused in flight, where `land` and `stop` end it
    Disarm,
    /// Give control back to the configured law after the fallback law took over
    Resume,
    /// Descend at the present position, then motors off
    Land,
    /// Fly to a point and stay there
    Goto,
    /// Fly another trajectory from the present point, then stay
    Fly,
    /// Come to rest and stay
    Hover,
    /// Change settings between two ticks, all of them or none
    Set,
    /// Show the value of a setting; without a key, law, trajectory, and the settings changed since the daemon's start
    Get,
    /// Take the last change of settings back
    Undo,
    /// Change the settings that differ in a file, or in the files of the daemon
    Reload,
    /// Change the attitude law
    Controller,
    /// Motors off at once, in flight too: the vehicle falls. They stay off until `arm`
    Stop,
}

impl CtlRequest {
    /// The request with this name.
    ///
    /// # Errors
    /// No request has this name; the text lists the known names.
    pub fn named(name: &str) -> Result<Self, String> {
        Self::from_str(name, false).map_err(|_| {
            let known = Self::value_variants().iter().filter_map(Self::to_possible_value);
            let known: Vec<_> = known.map(|it| it.get_name().to_owned()).collect();
            format!("unknown request `{name}`; known: {}", known.join(", "))
        })
    }

    /// The command to the daemon.
    pub fn command(self) -> OperatorCommand {
        match self {
            Self::Status => OperatorCommand::Status,
            Self::Arm => OperatorCommand::Arm,
            Self::Disarm => OperatorCommand::Disarm,
            Self::Resume => OperatorCommand::Resume,
            Self::Land => OperatorCommand::Land,
            Self::Goto => OperatorCommand::Goto,
            Self::Fly => OperatorCommand::Trajectory,
            Self::Hover => OperatorCommand::Hover,
            Self::Set | Self::Controller => OperatorCommand::Set,
            Self::Get => OperatorCommand::Get,
            Self::Undo => OperatorCommand::Undo,
            Self::Reload => OperatorCommand::Reload,
            Self::Stop => OperatorCommand::Stop,
        }
    }

    /// Whether the command ends a flight.
    pub fn ends_flight(self) -> bool {
        matches!(self, Self::Land | Self::Stop)
    }
}

/// The request for `command` with `arguments`.
///
/// # Errors
/// The arguments are not those of the command (exit code 64).
pub fn request_of(command: CtlRequest, arguments: &[String]) -> Result<ControlRequestV1, Failure> {
    let base = ControlRequestV1::of(command.command());
    let with_text = |lines: &[String]| {
        let text = LongText::of_lines(lines.iter().map(String::as_str));
        let text = text.ok_or_else(|| usage("the settings are longer than 1000 bytes"))?;
        Ok(ControlRequestV1 { text, ..base })
    };
    let is_text = |argument: &String| !argument.contains(char::is_control);
    if command != CtlRequest::Stop && !arguments.iter().all(is_text) {
        return Err(usage("an argument contains control characters"));
    }
    match (command, arguments) {
        (CtlRequest::Goto, [_, _, _] | [_, _, _, _]) => goto(base, arguments),
        (CtlRequest::Goto, _) => Err(usage("goto needs X Y Z in m and, if wanted, YAW in degrees")),
        (CtlRequest::Fly, [_]) | (CtlRequest::Get, [_]) => with_text(arguments),
        (CtlRequest::Fly, _) => {
            Err(usage("fly needs the name of a trajectory, as in `fly circle`"))
        }
        (CtlRequest::Get, [_, ..]) => {
            Err(usage("get takes one key, as in `get position.tilt-limit-deg`, or none"))
        }
        (CtlRequest::Controller, [law]) => with_text(&[format!("control.controller={law}")]),
        (CtlRequest::Controller, _) => Err(usage("controller needs the name of a law")),
        (CtlRequest::Set, [_, ..]) => {
            let settings = arguments.iter().map(|setting| with_absolute_path(setting));
            with_text(&settings.collect::<Result<Vec<_>, _>>()?)
        }
        (CtlRequest::Set, _) => {
            Err(usage("set needs KEY=VALUE, as in `set position.tilt-limit-deg=15`"))
        }
        (CtlRequest::Reload, [file]) => with_text(&[absolute(file)?]),
        // A stop is accepted whatever arguments follow it.
        (_, []) | (CtlRequest::Stop, _) => Ok(base),
        (_, [first, ..]) => Err(usage(&format!("unexpected argument `{first}`"))),
    }
}

/// `file` as an absolute path: the daemon runs in another directory.
fn absolute(file: &str) -> Result<String, Failure> {
    let path = std::path::absolute(Path::new(file));
    let path = path.map_err(|error| usage(&format!("file `{file}`: {error}")))?;
    Ok(path.display().to_string())
}

/// `KEY=VALUE`, with an absolute path if the value is one.
fn with_absolute_path(setting: &str) -> Result<String, Failure> {
    const FILE: &str = "trajectory.waypoints-file=";
    match setting.strip_prefix(FILE) {
        Some(file) => Ok(format!("{FILE}{}", absolute(file.trim_matches('"'))?)),
        None => Ok(setting.to_owned()),
    }
}

fn goto(base: ControlRequestV1, arguments: &[String]) -> Result<ControlRequestV1, Failure> {
    let mut numbers = [f64::NAN; 4];
    for (number, text) in numbers.iter_mut().zip(arguments) {
        let parsed = text.parse().ok().filter(|value: &f64| value.is_finite());
        let message =
            || usage(&format!("`{text}` is not a number: X Y Z are in m, YAW in degrees"));
        *number = parsed.ok_or_else(message)?;
    }
    let [x, y, z, yaw_deg] = numbers;
    if yaw_deg.abs() > 360.0 {
        return Err(usage(&format!("YAW is {yaw_deg}, expected -360 to 360 degrees")));
    }
    Ok(ControlRequestV1 { point: [x, y, z], yaw: yaw_deg.to_radians(), ..base })
}

fn usage(reason: &str) -> Failure {
    Failure::new(Exit::Usage, format!("ctl: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(command: CtlRequest, arguments: &[&str]) -> Result<ControlRequestV1, Failure> {
        let arguments: Vec<_> = arguments.iter().map(|text| (*text).to_owned()).collect();
        request_of(command, &arguments)
    }

    #[test]
    fn arguments_become_the_content_of_a_request() {
        let goto = of(CtlRequest::Goto, &["1", "-2", "0.5", "90"]).unwrap();
        assert_eq!((goto.point, goto.yaw), ([1.0, -2.0, 0.5], 90_f64.to_radians()));
        assert!(of(CtlRequest::Goto, &["1", "2", "3"]).unwrap().yaw.is_nan());
        let set = of(CtlRequest::Set, &["a.b=1", "c.d=2"]).unwrap();
        assert_eq!(set.text.as_str(), "a.b=1\nc.d=2");
        let set = of(CtlRequest::Set, &["trajectory.waypoints-file=\"p.csv\""]).unwrap();
        let file = std::path::absolute("p.csv").unwrap();
        assert_eq!(set.text.as_str(), format!("trajectory.waypoints-file={}", file.display()));
        let law = of(CtlRequest::Controller, &["pid"]).unwrap();
        assert_eq!(law.text.as_str(), "control.controller=pid");
        assert!(of(CtlRequest::Reload, &["x.toml"]).unwrap().text.as_str().starts_with('/'));
    }

    #[test]
    fn other_arguments_are_a_usage_error() {
        let wrong: [(CtlRequest, &[&str]); 8] = [
            (CtlRequest::Set, &["a.b=1\0 c.d=2"]),
            (CtlRequest::Goto, &["1", "2"]),
            (CtlRequest::Goto, &["1", "2", "nan"]),
            (CtlRequest::Goto, &["1", "2", "3", "900"]),
            (CtlRequest::Set, &[]),
            (CtlRequest::Fly, &[]),
            (CtlRequest::Get, &["a", "b"]),
            (CtlRequest::Controller, &[]),
        ];
        for (command, arguments) in wrong {
            assert_eq!(of(command, arguments).unwrap_err().exit, Exit::Usage, "{arguments:?}");
        }
    }
}
