//! Arguments common to all studies: vehicle, environment, trajectory and seeds.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::OnceLock;

use clap::Args;
use oqtal_bus::obeying::without_out;
use oqtal_bus::paths::quoted;
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure, SettingArgs};
use oqtal_runtime::program::say;
use toml::Value;

/// Arguments of the commands that fly simulated flights in large numbers.
#[derive(Args, Clone, Debug, Default)]
pub struct StudyArgs {
    /// Configuration file (TOML) of the vehicle and its environment, see `oqtal check`; may be repeated, later files override earlier ones
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    #[command(flatten)]
    settings: SettingArgs,
    /// Trajectory on which the errors of position, velocity and attitude are measured [default: that of the configuration, `square`]
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
}

impl StudyArgs {
    /// Settings of every flight of the study, in order of precedence.
    ///
    /// # Errors
    /// The file or a setting is invalid (exit code 78); a key is that of the law or the seed, which the study sets, or the
    /// configuration replaces the cameras by a recording (64).
    pub fn settings(&self) -> Result<Vec<Setting>, Failure> {
        let mut settings = Config::layers(&self.config)?;
        let own = self.settings.settings()?;
        own.iter()
            .try_for_each(|set| refuse_key_of_study(&format!("--set {}", set.key), &set.key))?;
        settings.extend(own);
        if let Some(name) = &self.trajectory {
            settings.push(Setting::flag("--trajectory", "trajectory.kind", name.as_str()));
        }
        let config = Config::from_settings(&settings)?;
        if config.is_replay() {
            let reason = "a study flies and does not play a recording; leave out `mocap.replay`";
            return Err(Failure::new(Exit::Usage, reason));
        }
        Ok(settings)
    }

    /// The arguments, and the settings of environment variables, as words of a command line, each preceded by a space.
    pub fn words(&self) -> String {
        let config = self.config.iter().map(|file| ("--config", file.display().to_string()));
        let variables = environment().into_iter().map(|setting| ("--set", assignment(&setting)));
        let trajectory = self.trajectory.iter().map(|name| ("--trajectory", name.clone()));
        let words = config.chain(variables).chain(self.settings.words()).chain(trajectory);
        words.map(|(flag, value)| format!(" {flag} {}", quoted(&value))).collect()
    }
}

/// Refuses the keys that a study sets for each flight, where `given` would set them.
///
/// # Errors
/// The key is that of the law or the seed (exit code 64).
pub fn refuse_key_of_study(given: &str, key: &str) -> Result<(), Failure> {
    let remedy = match key {
        "control.controller" => {
            "flies the laws that are named to it; give them with --laws, or as `oqtal tune LAW`"
        }
        "clock.seed" => "has seeds of its own; give others with --seeds, or as its --help says",
        _ => return Ok(()),
    };
    Err(Failure::new(Exit::Usage, format!("{given}: a study {remedy}")))
}

/// Settings of environment variables.
fn environment() -> Vec<Setting> {
    // They were valid when the study read its settings.
    Config::layers(&[]).unwrap_or_default()
}

/// A setting as `KEY=VALUE`.
fn assignment(Setting { key, value, .. }: &Setting) -> String {
    format!("{key}={}", written(value))
}

/// A value as a word of a command line, before it is quoted.
fn written(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The warnings of a flight of `config`; none if its trajectory cannot be read, which a flight reports.
pub fn warnings(config: &Config) -> Vec<String> {
    let trajectory = oqtal_daemon::trajectory(config);
    trajectory.map_or_else(|_| Vec::new(), |it| oqtal_daemon::warnings(config, &it))
}

/// Receiver of warnings in place of standard error.
static RECEIVER: OnceLock<fn(String)> = OnceLock::new();

/// Passes all later warnings to `receiver` instead of printing them.
pub fn receive_notes(receiver: fn(String)) {
    let _ = RECEIVER.set(receiver);
}

/// Prints warnings on standard error.
pub fn say_notes(notes: impl IntoIterator<Item = String>) {
    notes.into_iter().for_each(|note| match RECEIVER.get() {
        Some(receive) => receive(note),
        None => say(&format!("oqtal: warning: {note}")),
    });
}

/// `settings` as words of a command line of `oqtal fly`, each preceded by a space: files, the trajectory, disturbances, and each
/// other key, those of environment variables and of gains of deploy/tuned too; of a key that is set several times, the last value.
/// The law is left out: the command names it.
pub fn words_of(settings: &[Setting]) -> String {
    let mut words: Vec<String> = Vec::new();
    for (index, setting) in settings.iter().enumerate() {
        let Setting { key, value, .. } = setting;
        let is_replaced = settings[index + 1..].iter().any(|later| later.key == *key);
        let word = match (&key[..], value) {
            ("clock.kind" | "control.controller", _) => continue,
            _ if is_of_file(setting) => format!(" --config {}", quoted(file_of(setting))),
            _ if is_replaced => continue,
            ("trajectory.kind", Value::String(name)) => format!(" --trajectory {name}"),
            ("plant.disturb", Value::Array(all)) => {
                let texts = all.iter().filter_map(Value::as_str);
                texts.map(|text| format!(" --disturb {}", quoted(text))).collect()
            }
            _ => format!(" --set {}", quoted(&assignment(setting))),
        };
        if !words.contains(&word) {
            words.push(word);
        }
    }
    words.concat()
}

/// Origin of `setting` without the line.
fn file_of(setting: &Setting) -> &str {
    setting.origin.rsplit_once(':').map_or(&setting.origin, |(file, _)| file)
}

/// Whether `setting` is of a file, and not of a flag or a variable, which have precedence over files.
pub fn is_of_file(setting: &Setting) -> bool {
    file_of(setting).ends_with(".toml")
}

/// The command line of this study after its `OQTAL_` variables, without the arguments of the output and the variables of
/// `[instance]`.
pub fn command() -> String {
    let is_of_study = |setting: &Setting| !setting.key.starts_with("instance.");
    let variables = environment().into_iter().filter(is_of_study);
    let variables = variables
        .map(|Setting { value, origin, .. }| format!("{origin}={} ", quoted(&written(&value))));
    let words = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    variables.collect::<String>() + &command_of(words)
}

fn command_of(arguments: impl Iterator<Item = String>) -> String {
    let is_of_study = |word: &String| !["--resume", "--force", "--json"].contains(&word.as_str());
    let words = without_out(arguments).filter(is_of_study).map(|word| quoted(&word));
    ["oqtal".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// Parses seeds, `300-330` (both included) or `7`.
///
/// # Errors
/// The text has neither form, or the last seed is before the first.
pub fn parse_seeds(text: &str) -> Result<Range<u64>, String> {
    let form = || format!("`{text}` is neither FIRST-LAST, as in 300-330, nor one seed");
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let number = |text: &str| text.trim().parse::<u32>().map(u64::from).map_err(|_| form());
    let (first, last) = (number(first)?, number(last)?);
    if last < first {
        return Err(format!("the last seed, {last}, is before the first, {first}"));
    }
    Ok(first..last + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_runtime::process::PlantKeyArgs;

    #[test]
    fn seeds_are_a_range_with_both_ends_or_one() {
        assert_eq!(parse_seeds("300-330"), Ok(300..331));
        assert_eq!(parse_seeds("7"), Ok(7..8));
        for text in ["", "7-", "-7", "a-b", "9-8", "1..5", "99999999999"] {
            assert!(parse_seeds(text).is_err(), "{text}");
        }
    }

    #[test]
    fn of_a_key_that_is_set_twice_the_last_value_is_written() {
        let trajectory = |name: &str| Setting::flag("--trajectory", "trajectory.kind", name);
        let settings = [trajectory("hover"), trajectory("attitude-chirp")];
        assert_eq!(words_of(&settings), " --trajectory attitude-chirp");
    }

    #[test]
    fn every_setting_is_written_and_spaces_in_a_value_stay() {
        let settings = [
            Setting::flag("OQTAL_PLANT__RATE_LAG_MS", "plant.rate-lag-ms", 110),
            Setting::flag("--set", "trajectory.waypoints-file", "my way.csv"),
        ];
        let words = " --set plant.rate-lag-ms=110 --set 'trajectory.waypoints-file=my way.csv'";
        assert_eq!(words_of(&settings), words);
    }

    #[test]
    fn the_command_of_a_study_is_that_of_its_continuation() {
        let of = |words: &[&str]| command_of(words.iter().map(|word| (*word).to_owned()));
        let command = "oqtal campaign --set 'a=b c' --runs 6";
        let words =
            ["campaign", "--out", "d", "--set", "a=b c", "--runs", "6", "--resume", "--json"];
        assert_eq!(of(&words), command);
        assert_eq!(of(&["campaign", "--set", "a=b c", "--out=d", "--runs", "6"]), command);
    }

    #[test]
    fn keys_that_a_study_sets_are_refused_with_the_option_for_them() {
        for (setting, remedy) in [("control.controller=pid", "--laws"), ("clock.seed=5", "--seeds")]
        {
            let settings = SettingArgs { set: vec![setting.to_owned()], ..SettingArgs::default() };
            let refused = StudyArgs { settings, ..StudyArgs::default() }.settings().unwrap_err();
            assert_eq!(refused.exit, Exit::Usage);
            assert!(refused.message.contains(remedy), "{refused}");
        }
    }

    #[test]
    fn a_key_of_the_plant_does_not_change_the_vehicle() {
        let plant = PlantKeyArgs { plant: vec!["rate-lag-ms=80".to_owned()] };
        let settings = SettingArgs { plant, ..SettingArgs::default() };
        let settings = StudyArgs { settings, ..StudyArgs::default() }.settings().unwrap();
        let config = Config::from_settings(&settings).unwrap();
        assert_eq!((config.plant.rate_lag_ms, config.vehicle.rate_lag_ms), (80.0, 50.0));
    }
}
