//! Options for tests of the cameras.

use oqtal_config::{Config, MocapOptions, Setting};

/// `[mocap]` with the defaults and these values.
pub fn mocap(settings: &[(&str, toml::Value)]) -> MocapOptions {
    let settings: Vec<Setting> = settings
        .iter()
        .map(|(key, value)| Setting::flag("test", &format!("mocap.{key}"), value.clone()))
        .collect();
    Config::from_settings(&settings).unwrap().mocap
}
