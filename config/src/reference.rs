//! `[reference]`: references from outside, and legs to a point.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Section `[reference]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ReferenceOptions {
    /// Greatest horizontal speed of a leg to a point \[m/s\].
    pub leg_horizontal_m_s: f64,
    /// Greatest vertical speed of a leg to a point \[m/s\].
    pub leg_vertical_m_s: f64,
    /// Greatest acceleration of a leg to a point \[m/s^2\].
    pub leg_acceleration_m_s2: f64,
    /// Greatest rate of the yaw on a leg to a point \[deg/s\].
    pub leg_yaw_rate_deg_s: f64,
    /// Greatest speed of a planner's reference \[m/s\].
    pub speed_limit_m_s: f64,
    /// Greatest acceleration of a planner's reference \[m/s^2\].
    pub acceleration_limit_m_s2: f64,
    /// Greatest distance of a planner's reference from the present one \[m\].
    pub jump_limit_m: f64,
    /// Longest validity of a planner's reference \[ms\].
    pub longest_validity_ms: f64,
    /// Time at rest after the end of a planner's references until the vehicle lands \[ms\].
    pub land_after_ms: f64,
}

impl ReferenceOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("leg-horizontal-m-s", self.leg_horizontal_m_s, Rule::Between(0.05, 20.0)),
            ("leg-vertical-m-s", self.leg_vertical_m_s, Rule::Between(0.05, 10.0)),
            ("leg-acceleration-m-s2", self.leg_acceleration_m_s2, Rule::Between(0.05, 20.0)),
            ("leg-yaw-rate-deg-s", self.leg_yaw_rate_deg_s, Rule::Between(1.0, 720.0)),
            ("speed-limit-m-s", self.speed_limit_m_s, Rule::Between(0.01, 50.0)),
            ("acceleration-limit-m-s2", self.acceleration_limit_m_s2, Rule::Between(0.01, 100.0)),
            ("jump-limit-m", self.jump_limit_m, Rule::Between(0.0, 10.0)),
            ("longest-validity-ms", self.longest_validity_ms, Rule::Between(1.0, 10_000.0)),
            ("land-after-ms", self.land_after_ms, Rule::Between(0.0, 3_600_000.0)),
        ])
        .map_err(|error| error.within("reference"))
    }
}
