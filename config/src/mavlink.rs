//! `[bridge.mavlink]` and `[plant.wire.mavlink]`: addresses, rates and scales for MAVLink.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// `[bridge.mavlink]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MavlinkOptions {
    /// System id of this computer \[-\].
    pub system: u8,
    /// Component id of this computer \[-\].
    pub component: u8,
    /// Rate at which poses are sent to the vehicle, at most \[Hz\].
    pub pose_rate_hz: f64,
    /// Standard deviation of the sent position, per axis \[mm\].
    pub position_sd_mm: f64,
    /// Standard deviation of the sent attitude, per axis \[deg\].
    pub attitude_sd_deg: f64,
    /// Points `[delta_c, thrust]` from the fraction of maximum thrust to the thrust of a set-point \[-\].
    pub thrust_table: Vec<[f64; 2]>,
    /// File with the key for signing packets, 64 hexadecimal digits; empty for unsigned packets. Only bridge and chain
    /// read it, so that the key is not part of a recorded configuration.
    pub signing_key_file: String,
}

/// `[plant.wire.mavlink]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PlantMavlinkOptions {
    /// Points `[delta_c, thrust]` of the emulated autopilot \[-\].
    pub thrust_table: Vec<[f64; 2]>,
    /// Time after its start for which the emulated autopilot refuses to arm \[ms\].
    pub refuses_arming_ms: f64,
}

impl MavlinkOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("system", f64::from(self.system), Rule::Positive),
            ("component", f64::from(self.component), Rule::Positive),
            ("pose-rate-hz", self.pose_rate_hz, Rule::Between(5.0, 120.0)),
            ("position-sd-mm", self.position_sd_mm, Rule::Positive),
            ("attitude-sd-deg", self.attitude_sd_deg, Rule::Positive),
        ])
        .map_err(|error| error.within("mavlink"))
    }
}

impl PlantMavlinkOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([("refuses-arming-ms", self.refuses_arming_ms, Rule::NotNegative)])
            .map_err(|error| error.within("mavlink"))
    }
}
