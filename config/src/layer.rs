//! The layers of a configuration, files and the environment, as settings.

use std::ffi::OsString;
use std::path::Path;

use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

use crate::error::ConfigError;
use crate::reason::plain;
use crate::setting::{Setting, word_or_toml};
use crate::text::read_text;

/// Variables that begin with `OQTAL_` and are not settings: paths of recordings, interpreters and packages for tests, and
/// durations.
const OTHER_VARIABLES: [&str; 4] = ["RECORDINGS", "PEERS_PYTHON", "PEERS_NODE", "PEERS_SECONDS"];

/// Keys that name a file to read.
pub(crate) const FILE_KEYS: [&str; 3] =
    ["mocap.replay", "trajectory.waypoints-file", "bridge.mavlink.signing-key-file"];

/// Maximum length of a file \[MiB\].
const LONGEST_FILE_MIB: u64 = 1;

/// The settings of the file at `path`.
pub(crate) fn from_file(path: &Path) -> Result<Vec<Setting>, ConfigError> {
    from_toml(&path.display().to_string(), &read(path)?)
}

/// The text of the file at `path`.
fn read(path: &Path) -> Result<String, ConfigError> {
    let origin = || path.display().to_string();
    read_text(path, LONGEST_FILE_MIB).map_err(|error| ConfigError {
        origin: origin(),
        reason: format!("{error}; give another file"),
    })
}

/// Converts the offset of a byte in `text`, the content of the file `name`, to `FILE:LINE`.
fn place(name: String, text: &str) -> impl Fn(usize) -> String {
    move |offset| format!("{name}:{}", 1 + text[..offset].matches('\n').count())
}

/// Error of a file; `at` converts its offsets.
fn located(at: &dyn Fn(usize) -> String, error: &toml::de::Error) -> ConfigError {
    let origin = at(error.span().map_or(0, |span| span.start));
    ConfigError { origin, reason: plain(error.message()) }
}

/// Settings of a file with this name and text, each with its line. Relative paths in it start at its directory, so that a
/// flight's directory can be moved.
pub(crate) fn from_toml(file: &str, text: &str) -> Result<Vec<Setting>, ConfigError> {
    let at = place(file.to_owned(), text);
    let parsed = DeTable::parse(text).map_err(|error| located(&at, &error))?;
    let values: Table = text.parse().map_err(|error| located(&at, &error))?;
    let mut collector = Collector { at: &at, settings: Vec::new() };
    collector.collect(parsed.get_ref(), &values, "");
    let directory = Path::new(file).parent().unwrap_or(Path::new(""));
    let is_path = |setting: &&mut Setting| FILE_KEYS.contains(&setting.key.as_str());
    for setting in collector.settings.iter_mut().filter(is_path) {
        if let Some(path) = setting.value.as_str().filter(|path| !path.is_empty()) {
            setting.value = directory.join(path).display().to_string().into();
        }
    }
    Ok(collector.settings)
}

/// Names in the section `section` of the file at `path`, as far as it is readable, and the errors of the file.
pub(crate) fn salvage(path: &Path, section: &str) -> (Vec<Setting>, Vec<ConfigError>) {
    let (text, mut errors) = match read(path) {
        Ok(text) => (text, Vec::new()),
        Err(error) => return (Vec::new(), vec![error]),
    };
    let at = place(path.display().to_string(), &text);
    let (parsed, wrong) = DeTable::parse_recoverable(&text);
    errors.extend(wrong.iter().map(|error| located(&at, error)));
    let mut settings = Vec::new();
    let sections = parsed.get_ref().iter().filter(|(name, _)| name.get_ref() == section);
    for (_, found) in sections {
        let DeValue::Table(keys) = found.get_ref() else { continue };
        for (name, value) in keys {
            let DeValue::String(value) = value.get_ref() else { continue };
            let (key, value) = (format!("{section}.{}", name.get_ref()), value.as_ref().into());
            settings.push(Setting { key, value, origin: at(name.span().start) });
        }
    }
    (settings, errors)
}

/// Collects the settings of a file.
struct Collector<'a> {
    /// Maps the offset of a byte to `FILE:LINE`.
    at: &'a dyn Fn(usize) -> String,
    settings: Vec<Setting>,
}

impl Collector<'_> {
    /// Collects the keys of the section `path`, given with their positions and values.
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
        // Variables of other programs may contain arbitrary bytes.
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
