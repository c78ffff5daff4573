//! `oqtal check FILE…`, or with --config as elsewhere: the effective configuration, and its differences from the shipped vehicle.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use oqtal_config::{Config, Setting};
use oqtal_lab::mission::Mission;
use oqtal_runtime::process::{Exit, Failure, SettingArgs, check_instance, describe};
use oqtal_runtime::program::{print, say};
use toml::{Table, Value};

/// Arguments of `oqtal check`.
#[derive(Args, Debug)]
pub struct CheckArgs {
    /// Configuration files (TOML), later ones override earlier ones [default: the built-in values]
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The same, as for every other command
    #[arg(long, value_name = "FILE", conflicts_with = "files")]
    config: Vec<PathBuf>,
    #[command(flatten)]
    settings: SettingArgs,
}

impl CheckArgs {
    /// Checks the configuration like every process, and prints it.
    ///
    /// # Errors
    /// A file or a setting has an error (exit code 78, with its origin), or a file that it names is invalid (65).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = self.load()?;
        check_instance(&config)?;
        oqtal_bridge::check_options(&config).map_err(|error| config.locate(&error))?;
        oqtal_daemon::check(&config)?;
        oqtal_plant_sim::check(&config)?;
        oqtal_mocap_emu::check(&config)?;
        if config.receiver.link.is_empty() {
            // Emulated cameras: the vehicle starts at the origin, as in `oqtal fly`.
            Mission::new(config.clone())?;
        }
        let warnings = oqtal_daemon::warnings(&config, &oqtal_daemon::trajectory(&config)?);
        warnings.iter().for_each(|warning| say(&format!("oqtal: warning: {warning}")));
        changes(&config)?.iter().for_each(|line| say(&format!("oqtal: {line}")));
        print(&describe(&config))?;
        Ok(Exit::Ok)
    }

    fn load(&self) -> Result<Config, Failure> {
        let files = [&self.files[..], &self.config].concat();
        Ok(Config::load(&files, &self.settings.settings()?)?)
    }
}

/// Values of `[vehicle]` and of the filters' noise that differ from the shipped values of the preset, as after an identification:
/// one line per key.
fn changes(config: &Config) -> Result<Vec<String>, Failure> {
    let preset = Setting::flag("check", "vehicle.preset", config.vehicle.preset.as_str());
    let before = Config::from_settings(&[preset])?;
    let (now, before) = (keys(config)?, keys(&before)?);
    let changed = now.iter().filter(|(key, value)| before.get(*key) != Some(*value));
    Ok(changed.map(|(key, value)| change(key, value, before.get(key))).collect())
}

/// Values that an identification may change, by key.
fn keys(config: &Config) -> Result<BTreeMap<String, Value>, Failure> {
    let filter = &config.control.predictive.filter;
    let sections = [
        ("vehicle", Table::try_from(&config.vehicle)),
        ("control.predictive.filter", Table::try_from(filter)),
    ];
    let mut keys = BTreeMap::new();
    for (section, table) in sections {
        let table = table.map_err(|error| Failure::new(Exit::Internal, error.to_string()))?;
        keys.extend(table.into_iter().map(|(key, value)| (format!("{section}.{key}"), value)));
    }
    Ok(keys)
}

/// A change as text, in per cent for a number.
fn change(key: &str, now: &Value, before: Option<&Value>) -> String {
    let Some(before) = before else { return format!("{key} = {now}, without a shipped value") };
    let share = now.as_float().zip(before.as_float()).filter(|(_, before)| *before != 0.0);
    let share = share.map(|(now, before)| format!(", {:+.1} %", 100.0 * (now / before - 1.0)));
    format!("{key} = {now}, shipped {before}{}", share.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loaded(words: &[&str]) -> Config {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            check: CheckArgs,
        }
        let line = <Line as clap::Parser>::try_parse_from([&["check"], words].concat()).unwrap();
        line.check.load().unwrap()
    }

    #[test]
    fn settings_of_the_command_line_are_those_of_the_flight_commands() {
        let config = loaded(&["--set", "vehicle.rate-lag-ms=60", "--plant", "rate-lag-ms=80"]);
        assert_eq!((config.vehicle.rate_lag_ms, config.plant.rate_lag_ms), (60.0, 80.0));
    }

    #[test]
    fn files_are_given_by_themselves_or_with_the_option_of_other_commands() {
        let directory = tempfile::tempdir().unwrap();
        let files = ["60", "70"].map(|lag| {
            let file = directory.path().join(lag);
            std::fs::write(&file, format!("[vehicle]\nrate-lag-ms = {lag}.0\n")).unwrap();
            file.display().to_string()
        });
        for words in
            [vec![files[0].as_str(), &files[1]], vec!["--config", &files[0], "--config", &files[1]]]
        {
            assert_eq!(loaded(&words).vehicle.rate_lag_ms, 70.0, "{words:?}");
        }
    }

    #[test]
    fn differences_from_the_preset_are_listed() {
        assert_eq!(changes(&Config::default()).unwrap(), Vec::<String>::new());
        let settings = [
            Setting::flag("test", "vehicle.rate-lag-ms", 60.0),
            Setting::flag("test", "vehicle.rate-authority-rad-s", vec![2.0, 2.0, 1.5]),
        ];
        let said = changes(&Config::from_settings(&settings).unwrap()).unwrap();
        assert_eq!(
            said,
            [
                "vehicle.rate-authority-rad-s = [2.0, 2.0, 1.5], shipped [2.0, 2.0, 2.0]",
                "vehicle.rate-lag-ms = 60.0, shipped 50.0, +20.0 %",
            ]
        );
    }
}
