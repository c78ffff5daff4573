//! `[bridge.asctec]` and `[plant.wire.asctec]`: meaning of the counts of AscTec's serial interface, as plain numbers. The
//! processes at both ends of a wire convert them to the scales of `oqtal-wire`.

use oqtal_control::options::OptionError;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::Table;

/// One integer per stick of an axis: roll, pitch and yaw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AsctecSigns {
    /// About x: 1 or -1 \[-\].
    pub roll: i8,
    /// About y: 1 or -1 \[-\].
    pub pitch: i8,
    /// About z: 1 or -1 \[-\].
    pub yaw: i8,
}

/// Greatest counts sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AsctecLimits {
    /// Roll, either way \[counts\].
    pub roll: i16,
    /// Pitch, either way \[counts\].
    pub pitch: i16,
    /// Yaw, either way \[counts\].
    pub yaw: i16,
    /// Thrust \[counts\].
    pub thrust: i16,
}

/// `[bridge.asctec]` or `[plant.wire.asctec]`, without the meaning of the roll and pitch sticks, which follows from
/// `vehicle.interface` and `plant.interface`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AsctecOptions {
    /// Roll and pitch angle of a count \[mdeg\], for a vehicle commanded by attitude.
    pub angle_per_count_mdeg: f64,
    /// Yaw rate of a count \[mdeg/s\], for a vehicle commanded by attitude.
    pub yaw_rate_per_count_mdeg_s: f64,
    /// Signs of commands: the vehicle's axes against x forward, y left, z up.
    pub command_signs: AsctecSigns,
    /// Signs of telemetry: the vehicle's axes against x forward, y left, z up.
    pub telemetry_signs: AsctecSigns,
    /// Greatest counts sent.
    pub limit_counts: AsctecLimits,
    /// Points `[delta_c [0..1], counts]` of the thrust curve, linear in between \[-, counts\].
    pub thrust_table: Vec<[f64; 2]>,
    /// Counts of the yaw stick that, held without thrust, starts and stops the motors \[counts\].
    pub motor_yaw_counts: i16,
}

impl AsctecOptions {
    /// Converts the values to a type of another crate with the same keys, `oqtal_wire::asctec::Scales`. `section` is the section
    /// of their keys.
    ///
    /// # Errors
    /// The other type refuses the values.
    pub fn convert<T: DeserializeOwned>(&self, section: &str) -> Result<T, OptionError> {
        let table = Table::try_from(self).expect("the options are a table of plain values");
        table.try_into().map_err(|error: toml::de::Error| {
            OptionError::new(section, "unusable", format_args!("a scale: {}", error.message()))
        })
    }
}
