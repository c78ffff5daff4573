//! Presets: named sets of values.

use oqtal_control::options::OptionError;

use crate::error::ConfigError;
use crate::layer::from_toml;
use crate::setting::Setting;

/// Beginning of the file names of presets in origins.
pub(crate) const PRESET: &str = "preset ";

/// A preset.
struct Preset {
    /// Key that selects it.
    key: &'static str,
    /// Value of that key.
    name: &'static str,
    /// Content of its file; empty for the built-in values.
    text: &'static str,
}

/// All presets. A further one is a row and a file.
const PRESETS: [Preset; 10] = [
    Preset { key: "vehicle.preset", name: "hummingbird", text: "" },
    Preset {
        key: "vehicle.preset",
        name: "spacecraft",
        text: include_str!("../../deploy/presets/spacecraft.toml"),
    },
    Preset {
        key: "vehicle.preset",
        name: "crazyflie-2.1",
        text: include_str!("../../deploy/presets/crazyflie-2.1.toml"),
    },
    Preset {
        key: "vehicle.preset",
        name: "ardupilot-quad",
        text: include_str!("../../deploy/presets/ardupilot-quad.toml"),
    },
    Preset {
        key: "vehicle.preset",
        name: "px4-quad",
        text: include_str!("../../deploy/presets/px4-quad.toml"),
    },
    Preset {
        key: "vehicle.preset",
        name: "betaflight-quad",
        text: include_str!("../../deploy/presets/betaflight-quad.toml"),
    },
    Preset { key: "mocap.preset", name: "qualisys", text: "" },
    Preset {
        key: "mocap.preset",
        name: "ideal",
        text: include_str!("../../deploy/presets/mocap-ideal.toml"),
    },
    Preset {
        key: "mocap.preset",
        name: "measured",
        text: include_str!("../../deploy/presets/mocap-measured.toml"),
    },
    Preset {
        key: "mocap.preset",
        name: "room",
        text: include_str!("../../deploy/presets/mocap-room.toml"),
    },
];

/// Settings of all presets named in `settings`.
pub(crate) fn named_by(settings: &[Setting]) -> Result<Vec<Setting>, ConfigError> {
    let mut found = Vec::new();
    for Preset { key, name, text } in PRESETS {
        let last = settings.iter().rev().find(|setting| setting.key == key);
        if last.is_some_and(|setting| setting.value.as_str() == Some(name)) {
            found.extend(from_toml(&format!("{PRESET}{name}"), text)?);
        }
    }
    Ok(found)
}

/// Checks that `name`, the value of `key`, names a preset.
pub(crate) fn check(key: &str, name: &str) -> Result<(), OptionError> {
    let names: Vec<&str> =
        PRESETS.iter().filter(|preset| preset.key == key).map(|preset| preset.name).collect();
    if names.contains(&name) {
        return Ok(());
    }
    Err(OptionError::new(key, format_args!("`{name}`"), names.join(" or ")))
}
