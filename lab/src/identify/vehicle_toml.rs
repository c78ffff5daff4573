//! Findings as a configuration file, complete with the settings of the flight.

use oqtal_config::{Config, Fidelity, Setting};
use oqtal_observe::plot::unit::rounded;
use toml::{Table, Value};

use super::finding::{ParameterFinding, with_interval};
use super::identification::Identification;
use crate::mission::Mission;
use crate::study::flights::table;

/// Column of the remarks \[characters\].
const REMARKS_AT: usize = 39;

/// Sections that belong to one flight, and not to the vehicle and its laboratory.
const OF_ONE_FLIGHT: [&str; 7] =
    ["clock", "fault", "instance", "log", "plant", "realtime", "record"];
/// Keys that say what was flown. The sizes of trajectories are those for which the room has space.
const FLOWN: [&str; 7] = [
    "mocap.replay",
    "safety.observe-only",
    "trajectory.duration-s",
    "trajectory.kind",
    "trajectory.settle-s",
    "trajectory.hover.duration-s",
    "trajectory.waypoints-file",
];

/// A configuration with the findings, the interval beside each value, and with all settings of `config`, the configuration of the
/// flight, that describe the vehicle and its laboratory. Its trajectory is a hover if the default one cannot be flown there.
pub fn toml(identification: &Identification, config: &Config) -> String {
    let text = |trajectory: &[Setting]| text(identification, config, trajectory);
    let hover = [Setting::flag("identify", "trajectory.kind", "hover")];
    let flies = |text: &str| Config::parse("", text, &[]).is_ok_and(|it| Mission::new(it).is_ok());
    let (plain, hovering) = (text(&[]), text(&hover));
    if !flies(&plain) && flies(&hovering) { hovering } else { plain }
}

fn text(identification: &Identification, config: &Config, trajectory: &[Setting]) -> String {
    let poses = identification.poses;
    let mut text = format!(
        "# The vehicle, identified by `oqtal identify` from {poses} poses in the air. Behind each identified value: its 95 %\n\
         # interval and the value before. All other keys have the value with which the vehicle flew, except those of\n\
         # this flight alone: [instance], [record], [plant], [clock], [log], and the kind and duration of the trajectory. Keys\n\
         # that are not here have the value of the preset. A simulated vehicle follows [vehicle]; to\n\
         # simulate the vehicle of this flight, copy its [plant]: of that only the delay is here, if the stamps lack a part.\n"
    );
    let mut lines = configured(identification, config);
    lines.extend(trajectory.iter().map(|setting| {
        let (section, name) = setting.key.split_once('.').unwrap_or(("", &setting.key));
        let remark = "the default, a square, cannot be flown in this room";
        (section.to_owned(), commented(format!("{name} = {}", setting.value), remark))
    }));
    for key in identification.keys() {
        let (section, name) = key.rsplit_once('.').unwrap_or(("", key));
        lines.push((section.to_owned(), line(identification, key, name)));
    }
    // Rotors have a part of that delay in their own dynamics.
    if config.plant.fidelity == Fidelity::Eq61 {
        lines.extend(identification.plant_delays().into_iter().map(|setting| {
            let name = setting.key.trim_start_matches("plant.").to_owned();
            let value = with_decimals(rounded(setting.value.as_float().unwrap_or(0.0), 3));
            let remark =
                if name.starts_with("hidden") { "beyond the stamps" } else { "by the stamps" };
            ("plant".to_owned(), commented(format!("{name} = {value}"), remark))
        }));
    }
    // The sort is stable: in a section the configured keys, with the preset first, are before the identified ones.
    lines.sort_by(|a, b| a.0.cmp(&b.0));
    let mut section = String::new();
    for (own, line) in lines {
        if own != section {
            text += &format!("\n[{own}]\n");
            section = own;
        }
        text += &line;
    }
    text
}

/// Section and line of each key that was not identified and that differs from the preset of the vehicle; always of preset and mass.
fn configured(identification: &Identification, config: &Config) -> Vec<(String, String)> {
    let preset = Setting::flag("identify", "vehicle.preset", config.vehicle.preset.as_str());
    let shipped = Config::from_settings(&[preset]).unwrap_or_default();
    let (mut now, mut before) = (Vec::new(), Vec::new());
    flatten(&table(config), "", &mut now);
    flatten(&table(&shipped), "", &mut before);
    let is_written = |(section, name, value): &&(String, String, Value)| {
        let key = format!("{section}.{name}");
        let is_own = !OF_ONE_FLIGHT.iter().any(|other| section.split('.').next() == Some(other));
        let is_told = !before.iter().any(|(s, n, v)| (s, n, v) == (section, name, value));
        let is_always = ["vehicle.preset", "vehicle.mass-kg"].contains(&key.as_str());
        let is_flown = FLOWN.contains(&key.as_str());
        is_own && (is_told || is_always) && !is_flown && identification.values(&key).is_none()
    };
    let mut lines: Vec<_> = now
        .iter()
        .filter(is_written)
        .map(|(section, name, value)| (section.clone(), format!("{name} = {value}\n")))
        .collect();
    lines.sort_by_key(|(_, line)| !line.starts_with("preset"));
    lines
}

/// Appends the keys of `table`, which is the section `path`, as section, name and value.
fn flatten(table: &Table, path: &str, keys: &mut Vec<(String, String, Value)>) {
    for (name, value) in table {
        match value {
            Value::Table(inner) if path.is_empty() => flatten(inner, name, keys),
            Value::Table(inner) => flatten(inner, &format!("{path}.{name}"), keys),
            _ => keys.push((path.to_owned(), name.clone(), value.clone())),
        }
    }
}

fn line(identification: &Identification, key: &str, name: &str) -> String {
    let findings = identification.of_key(key);
    let remarks: Vec<String> = findings.iter().map(|finding| remark(finding)).collect();
    let remark = remarks.join("; ");
    let Some(values) = identification.values(key) else {
        return format!("# {name}: {remark}\n");
    };
    let number = |(value, finding): (&f64, &&ParameterFinding)| {
        let half_width = if finding.is_shown() { finding.half_width } else { 0.0 };
        with_decimals(with_interval(*value, half_width).0)
    };
    let numbers: Vec<String> = values.iter().zip(&findings).map(number).collect();
    let numbers = match numbers.as_slice() {
        [number] => number.clone(),
        several => format!("[{}]", several.join(", ")),
    };
    commented(format!("{name} = {numbers}"), &remark)
}

fn commented(line: String, remark: &str) -> String {
    format!("{line:<REMARKS_AT$} # {remark}\n")
}

/// `number` as a floating-point number of TOML.
fn with_decimals(number: String) -> String {
    if number.contains('.') { number } else { number + ".0" }
}

fn remark(finding: &ParameterFinding) -> String {
    let ParameterFinding { value, half_width, before, .. } = finding;
    let before = before.map_or(String::new(), |before| format!(", before {before}"));
    match finding.reason() {
        Some(reason) => {
            let (value, half) = with_interval(*value, *half_width);
            format!("not determined ({value} ± {half}{before}), {reason}")
        }
        None if *half_width == 0.0 => format!("given{before}"),
        None => format!("± {}{before}", with_interval(*value, *half_width).1),
    }
}
