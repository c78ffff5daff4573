//! Settings that change while the daemon runs: the permitted ones, the configuration with changes applied, and differences between
//! configurations.

use std::collections::BTreeMap;
use std::path::PathBuf;

use toml::{Table, Value};

use crate::config::{Config, DEFAULTS, deserialize, keep_file_name};
use crate::error::ConfigError;
use crate::layer::FILE_KEYS;
use crate::nearest_key::with_nearest_key;
use crate::origin::are_nested;
use crate::setting::Setting;
use crate::{follow, renamed};

/// Sections whose keys may change in flight.
const LIVE: [&str; 4] = ["control", "position", "trajectory", "reference"];

/// Keys whose change needs a restart of the daemon alone, since they are in none of the sections that the processes share, or of
/// keys in a live section.
const RESTART: [(&str, &str); 4] = [
    ("control.rate-hz", ALL),
    ("control.estimator", ALL),
    ("control.fallback", ALL),
    ("log", "the daemon"),
];
/// Processes to restart for any other key: they must run with one configuration.
const ALL: &str = "every process of the instance";

/// The processes to restart for a change of `key`; `None` if the key may change in flight.
fn restart_for(key: &str) -> Option<&'static str> {
    let is_within = |section: &str| {
        key.strip_prefix(section).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    let listed = RESTART.iter().find(|(section, _)| is_within(section));
    let is_live = LIVE.iter().any(|section| is_within(section));
    listed.map(|(_, process)| *process).or((!is_live).then_some(ALL))
}

impl Config {
    /// Whether `key` may change while the daemon runs.
    pub fn may_change_in_flight(key: &str) -> bool {
        restart_for(key).is_none()
    }

    /// This configuration with `settings`, checked as a whole.
    ///
    /// # Errors
    /// The first setting whose key is unknown or whose value breaks a rule, or a key that cannot change while the daemon runs.
    pub fn with_live(&self, settings: &[Setting]) -> Result<Self, ConfigError> {
        let mut table = self.to_table();
        let mut origins = self.origins.clone();
        for setting in &renamed::with_present_keys(settings) {
            setting.insert_into(&mut table)?;
            deserialize(&table)
                .map_err(|reason| setting.refused(&with_nearest_key(setting, reason, DEFAULTS)))?;
            origins.record(setting);
        }
        let error = |reason| ConfigError { origin: "settings".to_owned(), reason };
        let config = Self { origins, ..deserialize(&table).map_err(error)? };
        config.check()?;
        self.require_live(&config, settings)?;
        Ok(config)
    }

    /// Refuses a change to `next`, by `settings`, of a key that cannot change while the daemon runs.
    ///
    /// # Errors
    /// The setting because of which such a key changes, with the key that it was written with.
    pub fn require_live(&self, next: &Self, settings: &[Setting]) -> Result<(), ConfigError> {
        let error = |origin: &str, reason| ConfigError { origin: origin.to_owned(), reason };
        let changed = self.differences(next).map_err(|reason| error("settings", reason))?;
        let keys = changed.iter().map(|text| text.split('=').next().unwrap_or_default());
        let mut fixed: Vec<_> =
            keys.filter_map(|key| restart_for(key).map(|process| (key, process))).collect();
        let is_external = self.control.is_external() || next.control.is_external();
        if is_external && self.control.controller != next.control.controller {
            fixed.push(("control.controller", ALL));
        }
        let Some((first, process)) = fixed.first() else { return Ok(()) };
        let sets = |setting: &&Setting, key: &str| {
            let present = renamed::with_present_keys(std::slice::from_ref(*setting));
            present.iter().any(|setting| are_nested(&setting.key, key))
        };
        // Before a key that follows another one, the one that was written.
        let written = fixed.iter().find_map(|(key, process)| {
            let setting = settings.iter().rfind(|setting| sets(setting, key))?;
            Some((setting.key.as_str(), *process, setting.origin.as_str()))
        });
        // A line that was removed has no place in a file.
        let (key, process, origin) = written.unwrap_or((first, process, "settings"));
        let reason =
            format!("`{key}`: cannot change while the daemon runs; restart {process} with it");
        Err(error(origin, reason))
    }

    /// The configuration with these `settings` of its `files`, as they are now, and those of its own that are from none of the files:
    /// from flags, the environment, and the instance.
    ///
    /// # Errors
    /// Like [`Config::load`].
    pub fn with_files(
        &self,
        files: &[PathBuf],
        mut settings: Vec<Setting>,
    ) -> Result<Self, ConfigError> {
        settings.extend(self.origins.apart_from(files));
        Self::from_settings(&settings)
    }

    /// The value of the dotted key `key`, or of a section, as TOML on one line; `None` if there is none.
    pub fn value(&self, key: &str) -> Option<String> {
        let mut value = Value::Table(self.to_table());
        for name in key.split('.') {
            value = value.as_table_mut()?.remove(name)?;
        }
        Some(value.to_string())
    }

    /// Settings of `other` that differ from this configuration, as `KEY=VALUE`.
    ///
    /// # Errors
    /// A key of this configuration that `other` does not have, with its remedy.
    pub fn differences(&self, other: &Self) -> Result<Vec<String>, String> {
        if let Some(key) = self.keys_without_value_in(other).first() {
            return Err(format!(
                "`{key}`: cannot be removed while the daemon runs; set it to a value, or take its change back by the request `undo`"
            ));
        }
        Ok(self.changed_values(other))
    }

    /// Settings in which `other` differs, as `KEY=VALUE`, or as `KEY unset` if it does not have the key.
    pub fn described_differences(&self, other: &Self) -> Vec<String> {
        let unset = self.keys_without_value_in(other).into_iter();
        let unset = unset.map(|key| format!("{key} unset"));
        self.changed_values(other).into_iter().chain(unset).collect()
    }

    fn changed_values(&self, other: &Self) -> Vec<String> {
        changed(flattened(other.to_table()), &flattened(self.to_table()))
    }

    fn keys_without_value_in(&self, other: &Self) -> Vec<String> {
        let others = flattened(other.to_table());
        let own = flattened(self.to_table()).into_iter().map(|(key, _)| key);
        own.filter(|key| others.iter().all(|(it, _)| it != key)).collect()
    }

    /// Settings of this configuration because of which its hash differs from that of `other`, as `KEY=VALUE`.
    pub fn hashed_differences(&self, other: &Self) -> Vec<String> {
        changed(flattened(self.hashed()), &flattened(other.hashed()))
    }

    /// Every key with its value as TOML; of a file the name, since the files of a flight are copied.
    pub fn comparable_values(&self) -> BTreeMap<String, String> {
        let mut table = self.to_table();
        FILE_KEYS.iter().for_each(|key| keep_file_name(&mut table, key));
        flattened(table).into_iter().collect()
    }

    /// Whether the modelled and the simulated vehicle have every value of the preset that they are named after.
    pub fn has_vehicle_of_preset(&self) -> bool {
        let preset = Setting::flag("preset", "vehicle.preset", self.vehicle.preset.as_str());
        let Ok(shipped) = Self::from_settings(&[preset]) else { return false };
        let tables = [self, &shipped].map(Self::to_table);
        let values =
            |key: &str| tables.each_ref().map(|table| follow::value_at(table, key).cloned());
        let is_same = |key: String| matches!(&values(&key), [own, other] if own == other);
        self.vehicle == shipped.vehicle && follow::airframe().all(is_same)
    }

    fn to_table(&self) -> Table {
        Table::try_from(self).expect("a configuration holds only what TOML can say")
    }
}

/// Every key with its value.
fn flattened(table: Table) -> Vec<(String, String)> {
    let mut entries = Vec::new();
    flatten("", &Value::Table(table), &mut entries);
    entries
}

/// The entries of `own` that `others` does not have, as `KEY=VALUE`.
fn changed(own: Vec<(String, String)>, others: &[(String, String)]) -> Vec<String> {
    let changed = own.into_iter().filter(|entry| !others.contains(entry));
    changed.map(|(key, value)| format!("{key}={value}")).collect()
}

/// Adds every key below `path` with its value.
fn flatten(path: &str, value: &Value, entries: &mut Vec<(String, String)>) {
    match value {
        Value::Table(table) => {
            for (name, value) in table {
                let dot = if path.is_empty() { "" } else { "." };
                flatten(&format!("{path}{dot}{name}"), value, entries);
            }
        }
        value => entries.push((path.to_owned(), value.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(config: &Config, texts: &[&str]) -> Result<Config, String> {
        let settings: Vec<_> =
            texts.iter().map(|text| Setting::parse("set", text).unwrap()).collect();
        config.with_live(&settings).map_err(|error| error.to_string())
    }

    #[test]
    fn a_live_setting_changes_its_key_alone_and_is_a_difference() {
        let config = Config::default();
        let next =
            changed(&config, &["position.horizontal-position.kp=1.7", "control.controller=lqr"])
                .unwrap();
        assert_eq!(next.value("position.horizontal-position.kp").as_deref(), Some("1.7"));
        let differences = config.differences(&next).unwrap();
        assert_eq!(differences.len(), 2, "{differences:?}");
        assert_eq!(changed(&config, &[&differences[0], &differences[1]]).unwrap(), next);
    }

    #[test]
    fn a_key_that_needs_a_restart_or_is_wrong_is_refused_with_its_name() {
        let config = Config::default();
        for (text, part) in [
            ("vehicle.mass-kg=0.6", "restart every process"),
            ("control.rate-hz=50", "restart every process"),
            ("control.estimator.rate-cutoff-hz=3", "restart every process"),
            ("position.tilt-limit-deg=95", "must be"),
            ("position.tilt-limit-dog=9", "tilt-limit-deg"),
            ("control.controller=none", "unknown value"),
        ] {
            let told = changed(&config, &[text]).unwrap_err();
            let key = text.split_once('=').unwrap().0;
            assert!(told.contains(part) && told.contains(key), "{told}");
        }
    }
}
