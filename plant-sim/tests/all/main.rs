//! Tests of the simulated vehicle, of its emulated on-board computers, and of the program.

mod air;
mod crazyflie;
mod disturbances;
mod firmware;
mod mavlink;
mod msp;
mod plant;
mod program;
mod radio;
mod stop;
mod wired;

use oqtal_bus::time::Time;
use oqtal_config::{Config, Setting};

const START: Time = Time::VIRTUAL_START;

/// Thrust at which the default Hummingbird hovers \[0..1\].
const HOVER: f64 = 0.5 * 9.81 / 20.0;

/// The defaults with these values.
fn configured(settings: &[(&str, toml::Value)]) -> Config {
    let setting = |(key, value): &(&str, toml::Value)| Setting::flag("test", key, value.clone());
    Config::from_settings(&settings.iter().map(setting).collect::<Vec<_>>()).unwrap()
}

/// The defaults without gusts, drift, constant force and their spread, with these values.
fn calm(settings: &[(&str, toml::Value)]) -> Config {
    let zeros = || toml::Value::from(vec![0.0; 3]);
    let calm = [
        ("plant.gust-sd-m-s2", 0.0.into()),
        ("plant.disturbance-spread", 0.0.into()),
        ("plant.rate-drift-deg-s", zeros()),
        ("plant.force-n", zeros()),
    ];
    configured(&[&calm, settings].concat())
}
