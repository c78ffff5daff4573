//! Python values as settings of the configuration.

use std::path::PathBuf;

use oqtal_config::{Config, Setting, refuse_thrust_alone};
use oqtal_runtime::process::Failure;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::{Table, Value};

use crate::error;

/// Deepest nesting of a value \[-\].
const MAX_DEPTH: u32 = 16;

/// Files and settings of a call: `(files, [(origin, key, value), …])`. With `None` in place of files neither files nor the
/// environment are read: the settings are complete.
#[derive(Debug)]
pub struct Sources {
    files: Option<Vec<PathBuf>>,
    settings: Vec<Setting>,
}

impl<'a, 'py> FromPyObject<'a, 'py> for Sources {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let (files, given): (Option<Vec<PathBuf>>, Vec<(String, String, Bound<'py, PyAny>)>) =
            object.extract()?;
        let settings: PyResult<Vec<Setting>> = given.into_iter().map(setting_of).collect();
        Ok(Self { files, settings: settings? })
    }
}

impl Sources {
    /// The settings of files and environment, overridden by those of the call; complete settings as they are, in their order.
    ///
    /// # Errors
    /// A file is invalid.
    pub fn settings(&self) -> Result<Vec<Setting>, Failure> {
        let Some(files) = &self.files else { return Ok(self.settings.clone()) };
        let mut settings = Config::layers(files)?;
        // A dictionary is checked like a file; a single setting may differ from the preset.
        let (of_config, others): (Vec<_>, Vec<_>) =
            self.settings.iter().cloned().partition(|setting| setting.origin == "config");
        let is_given = !of_config.is_empty();
        settings.extend(of_config);
        if is_given {
            refuse_thrust_alone(&settings)?;
        }
        settings.extend(others);
        Ok(settings)
    }

    /// The settings of the call alone, as `KEY=VALUE` in TOML.
    pub fn texts(&self) -> Vec<String> {
        self.settings.iter().map(|setting| format!("{}={}", setting.key, setting.value)).collect()
    }

    /// The effective configuration.
    ///
    /// # Errors
    /// A file or a setting is invalid.
    pub fn config(&self) -> Result<Config, Failure> {
        Ok(Config::from_settings(&self.settings()?)?)
    }
}

/// Setting of a call.
///
/// # Errors
/// The value has no form in TOML.
pub fn setting_of((origin, key, value): (String, String, Bound<'_, PyAny>)) -> PyResult<Setting> {
    let value = toml_of(&value, MAX_DEPTH).map_err(|kind| {
        let reason = "a setting is a number, a text, True, False, or a list of them";
        error::usage(format!("{origin}: {key} is {kind}; {reason}"))
    })?;
    Ok(Setting { key, value, origin })
}

/// `value`, nested at most `depth` times, in TOML; the name of its type if it has no such form.
fn toml_of(value: &Bound<'_, PyAny>, depth: u32) -> Result<Value, String> {
    let Some(depth) = depth.checked_sub(1) else { return Err("nested too deeply".to_owned()) };
    let unknown = |_: PyErr| type_name(value);
    if value.is_instance_of::<PyBool>() {
        return value.extract::<bool>().map(Value::from).map_err(unknown);
    }
    if value.is_instance_of::<PyInt>() {
        return value
            .extract::<i64>()
            .map(Value::from)
            .map_err(|_| "an integer beyond 64 bits".to_owned());
    }
    if value.is_instance_of::<PyFloat>() {
        return value.extract::<f64>().map(Value::from).map_err(unknown);
    }
    if value.is_instance_of::<PyString>() {
        return value.extract::<String>().map(Value::from).map_err(unknown);
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let entry = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
            Ok((key.extract::<String>().map_err(|_| type_name(&key))?, toml_of(&value, depth)?))
        };
        return table.iter().map(entry).collect::<Result<Table, String>>().map(Value::from);
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let items = value.try_iter().map_err(unknown)?;
        let item = |item: PyResult<Bound<'_, PyAny>>| toml_of(&item.map_err(unknown)?, depth);
        return items.map(item).collect::<Result<Vec<Value>, String>>().map(Value::from);
    }
    // Scalars and arrays of NumPy.
    match value.call_method0("tolist") {
        Ok(plain) if !plain.is(value) => toml_of(&plain, depth),
        _ => Err(type_name(value)),
    }
}

/// Name of the type of `value`, for messages.
fn type_name(value: &Bound<'_, PyAny>) -> String {
    let name = value.get_type().name().map(|name| name.to_string());
    format!("of type `{}`", name.unwrap_or_else(|_| "unknown".to_owned()))
}
