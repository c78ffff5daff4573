//! Values of a configuration by their keys.

use oqtal_config::Config;

/// The value of a numeric `key` of `config`.
///
/// # Panics
/// If there is no such key: a test holds that every parameter is one.
#[must_use]
pub fn value_of(config: &Config, key: &str) -> f64 {
    let table: toml::Table = config.to_toml().parse().expect("written by us");
    let mut value = &toml::Value::Table(table);
    for name in key.split('.') {
        value = &value[name];
    }
    value.as_float().expect("a parameter is a number")
}
