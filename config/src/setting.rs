//! A value for the configuration, with its origin.

use std::fmt::Display;
use std::str::FromStr;

use oqtal_control::options::OptionError;
use toml::{Table, Value};

use crate::error::ConfigError;
use crate::follow::follow_word;

/// One value for one key.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// The key, dotted: `vehicle.mass-kg`.
    pub key: String,
    /// The value.
    pub value: Value,
    /// Origin: `FILE:LINE`, a variable, a flag.
    pub origin: String,
}

impl Setting {
    /// A setting made by a flag.
    pub fn flag(flag: &str, key: &str, value: impl Into<Value>) -> Self {
        Self { key: key.to_owned(), value: value.into(), origin: flag.to_owned() }
    }

    /// A setting written as `KEY=VALUE`, the value in TOML or a bare word.
    ///
    /// # Errors
    /// `text` has no `=`.
    pub fn parse(flag: &str, text: &str) -> Result<Self, ConfigError> {
        let Some((key, value)) = text.split_once('=') else {
            let reason = format!("`{text}` is not KEY=VALUE, as in position.tilt-limit-deg=15");
            return Err(ConfigError { origin: flag.to_owned(), reason });
        };
        Ok(Self::flag(flag, key.trim(), word_or_toml(value.trim())))
    }

    /// Setting of the section `section`, written as `KEY=VALUE` with the key relative to the section.
    ///
    /// # Errors
    /// `text` has no `=`.
    pub fn parse_in(section: &str, flag: &str, text: &str) -> Result<Self, ConfigError> {
        let setting = Self::parse(flag, text)?;
        Ok(Self { key: format!("{section}.{}", setting.key), ..setting })
    }

    /// Writes the value into `table`, with the sections of its key.
    pub(crate) fn insert_into(&self, table: &mut Table) -> Result<(), ConfigError> {
        let (path, name) = self.key.rsplit_once('.').unwrap_or(("", &self.key));
        let mut section = table;
        let mut key = String::new();
        for name in path.split('.').filter(|name| !name.is_empty()) {
            key += if key.is_empty() { "" } else { "." };
            key += name;
            let value =
                section.entry(name.to_owned()).or_insert_with(|| Value::Table(Table::new()));
            // A table that followed another one now has separate values.
            if value.is_str() && value.as_str() == follow_word(&key).as_deref() {
                *value = Value::Table(Table::new());
            }
            let Some(inner) = value.as_table_mut() else {
                return Err(self.refused(&format!("`{name}` is a key, not a section")));
            };
            section = inner;
        }
        section.insert(name.to_owned(), self.value.clone());
        Ok(())
    }

    /// Whether the setting determines which instance a process belongs to.
    pub fn is_of_instance(&self) -> bool {
        self.key.starts_with("instance.")
    }

    /// File of the setting; `None` if it is from another source.
    pub(crate) fn file(&self) -> Option<&str> {
        // The origin is FILE:LINE.
        Some(self.origin.rsplit_once(':')?.0)
    }

    /// Error of this setting, with a reason.
    pub(crate) fn refused(&self, reason: &str) -> ConfigError {
        ConfigError { origin: self.origin.clone(), reason: format!("`{}`: {reason}", self.key) }
    }
}

/// Parses the text of the option `key`, which describes `object`; `None` for an empty text.
///
/// # Errors
/// The text cannot be parsed.
pub fn parse_option<T>(key: &str, text: &str, object: &str) -> Result<Option<T>, OptionError>
where
    T: FromStr<Err: Display>,
{
    if text.is_empty() {
        return Ok(None);
    }
    let parsed = text.parse().map(Some);
    parsed.map_err(|error| OptionError::new(key, format!("`{text}`"), format!("{object}: {error}")))
}

/// The TOML value of `text`, or `text` itself as a string if it is not TOML. `.5` and `5.` are numbers, too, unlike in TOML.
pub(crate) fn word_or_toml(text: &str) -> Value {
    let parsed: Result<Table, _> = format!("value = {text}").parse();
    let number = || text.parse().ok().filter(|_| text.contains('.')).map(Value::Float);
    let value = parsed.ok().and_then(|mut table| table.remove("value"));
    value.or_else(number).unwrap_or_else(|| Value::String(text.to_owned()))
}
