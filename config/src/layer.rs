//! Values on their way into the configuration, each with its origin.

use std::ffi::OsString;

use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use crate::{Config, ConfigError};

/// One value for one key.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The key, dotted: `vehicle.mass-kg`.
    pub key: String,
    /// The value.
    pub value: Value,
    /// Where it was set: `FILE:LINE`, a variable, a flag.
    pub origin: String,
}

impl Setting {
    /// A setting made by a flag.
    #[must_use]
    pub fn flag(flag: &str, key: &str, value: impl Into<Value>) -> Self {
        Self { key: key.to_owned(), value: value.into(), origin: flag.to_owned() }
    }

    /// A setting written as `KEY=VALUE`, the value in TOML or a bare word.
    ///
    /// # Errors
    /// There is no `=`.
    pub fn parse(flag: &str, text: &str) -> Result<Self, ConfigError> {
        let Some((key, value)) = text.split_once('=') else {
            let reason = format!("`{text}` is not KEY=VALUE, as in vehicle.mass-kg=0.6");
            return Err(ConfigError { origin: flag.to_owned(), reason });
        };
        Ok(Self::flag(flag, key.trim(), word_or_toml(value.trim())))
    }

    /// Writes this value into `table`, which says a configuration, and sees whether it still does.
    pub(crate) fn apply(&self, table: &mut Table) -> Result<(), ConfigError> {
        let failed = |reason: &str| ConfigError {
            origin: self.origin.clone(),
            reason: format!("`{}`: {reason}", self.key),
        };
        let mut path: Vec<&str> = self.key.split('.').collect();
        let key = path.pop().unwrap_or_default();
        let mut section = &mut *table;
        for name in path {
            section = section
                .entry(name)
                .or_insert_with(|| Value::Table(Table::new()))
                .as_table_mut()
                .ok_or_else(|| failed(&format!("`{name}` is a key, not a section")))?;
        }
        section.insert(key.to_owned(), self.value.clone());
        deserialize(table).map(drop).map_err(|reason| failed(&reason))
    }
}

/// The configuration that a complete table says; the reason on one line if it says none.
pub(crate) fn deserialize(table: &Table) -> Result<Config, String> {
    table.clone().try_into().map_err(|error: toml::de::Error| error.message().to_owned())
}

/// The settings of a file, with their lines.
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
    let mut settings = Vec::new();
    collect(parsed.get_ref(), &values, "", &at, &mut settings);
    Ok(settings)
}

fn collect(
    parsed: &DeTable<'_>,
    values: &Table,
    path: &str,
    at: &dyn Fn(usize) -> String,
    settings: &mut Vec<Setting>,
) {
    for (name, spanned) in parsed {
        let name: &Spanned<_> = name;
        let key = if path.is_empty() {
            name.get_ref().to_string()
        } else {
            format!("{path}.{}", name.get_ref())
        };
        match (spanned.get_ref(), values.get(name.get_ref().as_ref())) {
            (DeValue::Table(inner), Some(Value::Table(values))) => {
                collect(inner, values, &key, at, settings);
            }
            (_, Some(value)) => {
                settings.push(Setting { key, value: value.clone(), origin: at(name.span().start) })
            }
            (_, None) => {}
        }
    }
}

/// `OQTAL_VEHICLE__MASS_KG=0.55` sets `vehicle.mass-kg`; `OQTAL_ROOT` sets `instance.root`.
pub(crate) fn from_environment(
    variables: impl Iterator<Item = (OsString, OsString)>,
) -> Result<Vec<Setting>, ConfigError> {
    let mut settings = Vec::new();
    for (name, value) in variables {
        // Variables of others may be anything.
        let (name, value) = (name.to_string_lossy(), value.to_string_lossy());
        let Some(rest) = name.strip_prefix("OQTAL_") else { continue };
        let key = match rest {
            "ROOT" => "instance.root".to_owned(),
            // Where tests find recordings, and the implementations they compare with: not settings.
            "RECORDINGS" | "PEERS_PYTHON" => continue,
            _ => rest.to_ascii_lowercase().replace("__", ".").replace('_', "-"),
        };
        settings.push(Setting { key, value: word_or_toml(&value), origin: name.into_owned() });
    }
    // The order of the environment is not ours; equal keys cannot occur.
    settings.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(settings)
}

/// A TOML value, or the text itself where it is none.
fn word_or_toml(text: &str) -> Value {
    let parsed: Result<Table, _> = format!("value = {text}").parse();
    parsed
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_owned()))
}
