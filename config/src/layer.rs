//! The layers of a configuration, files and the environment, as settings.

use std::ffi::OsString;
use std::path::Path;

use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use crate::error::ConfigError;
use crate::setting::{Setting, word_or_toml};

/// Variables that begin with `OQTAL_` and are no settings: where tests find recordings, an interpreter and packages with the
/// libraries that tests compare with, and for how long.
const OTHER_VARIABLES: [&str; 4] = ["RECORDINGS", "PEERS_PYTHON", "PEERS_NODE", "PEERS_SECONDS"];

/// The settings of the file at `path`.
pub(crate) fn from_file(path: &Path) -> Result<Vec<Setting>, ConfigError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|error| ConfigError { origin: name.clone(), reason: error.to_string() })?;
    from_toml(&name, &text)
}

/// The settings of a file with this name and text, each with its line.
pub(crate) fn from_toml(file: &str, text: &str) -> Result<Vec<Setting>, ConfigError> {
    let at = |offset: usize| format!("{file}:{}", 1 + text[..offset].matches('\n').count());
    let parsed = DeTable::parse(text).map_err(|error| ConfigError {
        origin: at(error.span().map_or(0, |span| span.start)),
        reason: error.message().to_owned(),
    })?;
    let values: Table = text.parse().map_err(|error: toml::de::Error| ConfigError {
        origin: file.to_owned(),
        reason: error.message().to_owned(),
    })?;
    let mut collector = Collector { at: &at, settings: Vec::new() };
    collector.collect(parsed.get_ref(), &values, "");
    Ok(collector.settings)
}

/// Collects the settings of a file.
struct Collector<'a> {
    /// From the offset of a byte to `FILE:LINE`.
    at: &'a dyn Fn(usize) -> String,
    settings: Vec<Setting>,
}

impl Collector<'_> {
    /// Collects the keys of the section `path`, given with the places of its keys and with its values.
    fn collect(&mut self, parsed: &DeTable<'_>, values: &Table, path: &str) {
        for (name, spanned) in parsed {
            let name: &Spanned<_> = name;
            let dot = if path.is_empty() { "" } else { "." };
            let key = format!("{path}{dot}{}", name.get_ref());
            match (spanned.get_ref(), values.get(name.get_ref().as_ref())) {
                (DeValue::Table(inner), Some(Value::Table(values))) => {
                    self.collect(inner, values, &key);
                }
                (_, Some(value)) => {
                    let origin = (self.at)(name.span().start);
                    self.settings.push(Setting { key, value: value.clone(), origin });
                }
                (_, None) => {}
            }
        }
    }
}

/// The settings among environment variables: `OQTAL_VEHICLE__MASS_KG=0.55` sets `vehicle.mass-kg`, `OQTAL_ROOT` sets
/// `instance.root`.
pub(crate) fn from_environment(
    variables: impl Iterator<Item = (OsString, OsString)>,
) -> Vec<Setting> {
    let mut settings = Vec::new();
    for (name, value) in variables {
        // Variables of other programs may hold any bytes.
        let (name, value) = (name.to_string_lossy(), value.to_string_lossy());
        let Some(rest) = name.strip_prefix("OQTAL_") else { continue };
        if OTHER_VARIABLES.contains(&rest) {
            continue;
        }
        let key = match rest {
            "ROOT" => "instance.root".to_owned(),
            _ => rest.to_ascii_lowercase().replace("__", ".").replace('_', "-"),
        };
        settings.push(Setting { key, value: word_or_toml(&value), origin: name.into_owned() });
    }
    // The operating system gives variables in any order; no key occurs twice.
    settings.sort_by(|a, b| a.key.cmp(&b.key));
    settings
}
