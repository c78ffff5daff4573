//! Requests that change a flight or its settings, from the arguments of the command line.

use std::path::Path;

use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::text::LongText;
use oqtal_runtime::process::{Exit, Failure};

use super::Request;

/// The request for `command` with `arguments`.
///
/// # Errors
/// The arguments are not those of the command (exit code 64).
pub fn request_of(command: Request, arguments: &[String]) -> Result<ControlRequestV1, Failure> {
    let base = ControlRequestV1::of(command.command());
    let with_text = |lines: &[String]| {
        let text = LongText::of_lines(lines.iter().map(String::as_str));
        let text = text.ok_or_else(|| usage("the settings are longer than 1000 bytes"))?;
        Ok(ControlRequestV1 { text, ..base })
    };
    match (command, arguments) {
        (Request::Goto, [_, _, _] | [_, _, _, _]) => goto(base, arguments),
        (Request::Goto, _) => Err(usage("goto needs X Y Z in m and, if wanted, YAW in degrees")),
        (Request::Fly, [_]) | (Request::Get, [_]) => with_text(arguments),
        (Request::Fly, _) => Err(usage("fly needs the name of a trajectory, as in `fly circle`")),
        (Request::Get, _) => Err(usage("get needs a key, as in `get position.tilt-limit-deg`")),
        (Request::Controller, [law]) => with_text(&[format!("control.controller={law}")]),
        (Request::Controller, _) => Err(usage("controller needs the name of a law")),
        (Request::Set, [_, ..]) => with_text(arguments),
        (Request::Set, _) => Err(usage("set needs KEY=VALUE, as in `set control.oqtal.gain=2`")),
        (Request::Reload, [file]) => {
            let path = std::path::absolute(Path::new(file));
            let path = path.map_err(|error| usage(&format!("{file}: {error}")))?;
            with_text(&[path.display().to_string()])
        }
        (_, []) => Ok(base),
        (_, [first, ..]) => Err(usage(&format!("unexpected argument `{first}`"))),
    }
}

fn goto(base: ControlRequestV1, arguments: &[String]) -> Result<ControlRequestV1, Failure> {
    let mut numbers = [f64::NAN; 4];
    for (number, text) in numbers.iter_mut().zip(arguments) {
        let parsed = text.parse().ok().filter(|value: &f64| value.is_finite());
        *number = parsed.ok_or_else(|| usage(&format!("`{text}` is not a number")))?;
    }
    let [x, y, z, yaw_deg] = numbers;
    Ok(ControlRequestV1 { point: [x, y, z], yaw: yaw_deg.to_radians(), ..base })
}

fn usage(reason: &str) -> Failure {
    Failure::new(Exit::Usage, format!("ctl: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(command: Request, arguments: &[&str]) -> Result<ControlRequestV1, Failure> {
        let arguments: Vec<_> = arguments.iter().map(|text| (*text).to_owned()).collect();
        request_of(command, &arguments)
    }

    #[test]
    fn arguments_become_the_content_of_a_request() {
        let goto = of(Request::Goto, &["1", "-2", "0.5", "90"]).unwrap();
        assert_eq!((goto.point, goto.yaw), ([1.0, -2.0, 0.5], 90_f64.to_radians()));
        assert!(of(Request::Goto, &["1", "2", "3"]).unwrap().yaw.is_nan());
        let set = of(Request::Set, &["a.b=1", "c.d=2"]).unwrap();
        assert_eq!(set.text.as_str(), "a.b=1\nc.d=2");
        let law = of(Request::Controller, &["pid"]).unwrap();
        assert_eq!(law.text.as_str(), "control.controller=pid");
        assert!(of(Request::Reload, &["x.toml"]).unwrap().text.as_str().starts_with('/'));
    }

    #[test]
    fn other_arguments_are_a_usage_error() {
        let wrong: [(Request, &[&str]); 7] = [
            (Request::Goto, &["1", "2"]),
            (Request::Goto, &["1", "2", "nan"]),
            (Request::Set, &[]),
            (Request::Fly, &[]),
            (Request::Get, &["a", "b"]),
            (Request::Stop, &["now"]),
            (Request::Controller, &[]),
        ];
        for (command, arguments) in wrong {
            assert_eq!(of(command, arguments).unwrap_err().exit, Exit::Usage, "{arguments:?}");
        }
    }
}
