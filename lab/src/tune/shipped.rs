//! Values of the shipped configuration.

use oqtal_config::Config;

/// The shipped value of a numeric `key`.
///
/// # Panics
/// If there is no such key: a test holds that every parameter is one.
#[must_use]
pub fn shipped(key: &str) -> f64 {
    let table: toml::Table = Config::default().to_toml().parse().expect("written by us");
    let mut value = &toml::Value::Table(table);
    for name in key.split('.') {
        value = &value[name];
    }
    value.as_float().expect("a parameter is a number")
}
