//! Options of estimation, prediction and the position law around `oqtal-dt`.

use serde::{Deserialize, Serialize};

use super::reference_model::ReferenceModelOptions;
use crate::options::{OptionError, Rule, check_options};

/// Options of the Kalman filters: measurement and process noise.
///
/// A *walk* is the standard deviation added to a state in one second by unmodelled effects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct FilterOptions {
    /// Standard deviation of a measured attitude about each axis \[deg\].
    pub attitude_noise_deg: f64,
    /// Standard deviation of a measured position along each axis \[mm\].
    pub position_noise_mm: f64,
    /// Walk of the body rate \[rad/s\].
    pub rate_walk_rad_s: f64,
    /// Walk of the bias of the demand \[rad/s, in torque form rad/s^2\].
    pub demand_bias_walk: f64,
    /// Walk of the velocity \[m/s\].
    pub velocity_walk_m_s: f64,
    /// Walk of the external acceleration \[m/s^2\].
    pub acceleration_walk_m_s2: f64,
}

impl Default for FilterOptions {
    fn default() -> Self {
        Self {
            attitude_noise_deg: 0.2,
            position_noise_mm: 0.5,
            rate_walk_rad_s: 0.5,
            demand_bias_walk: 0.0175,
            velocity_walk_m_s: 0.008,
            acceleration_walk_m_s2: 0.35,
        }
    }
}

impl FilterOptions {
    /// The options with the noise of a measured position \[m\] and attitude \[rad\], where it is greater.
    pub fn with_measured_noise(&self, position_m: f64, attitude_rad: f64) -> Self {
        Self {
            position_noise_mm: self.position_noise_mm.max(position_m * 1e3),
            attitude_noise_deg: self.attitude_noise_deg.max(attitude_rad.to_degrees()),
            ..*self
        }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-noise-deg", self.attitude_noise_deg, Rule::Between(1e-4, 45.0)),
            ("position-noise-mm", self.position_noise_mm, Rule::Between(1e-4, 1000.0)),
            ("rate-walk-rad-s", self.rate_walk_rad_s, Rule::Between(1e-6, 1000.0)),
            ("demand-bias-walk", self.demand_bias_walk, Rule::Between(0.0, 1000.0)),
            ("velocity-walk-m-s", self.velocity_walk_m_s, Rule::Between(1e-6, 1000.0)),
            ("acceleration-walk-m-s2", self.acceleration_walk_m_s2, Rule::Between(0.0, 1000.0)),
        ])
    }
}

/// Options of the adaptation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct AdaptationOptions {
    /// Whether the model is adapted in flight.
    pub adapt: bool,
    /// Greatest relative deviation of the rate over the commanded one \[-\].
    pub rate_gain_deviation: f64,
    /// Greatest deviation of the lag of the rate \[ms\].
    pub rate_lag_deviation_ms: f64,
    /// Greatest deviation of the rotation's delay from the reported one \[ms\].
    pub delay_deviation_ms: f64,
    /// Greatest relative deviation of the thrust over the mass \[-\].
    pub thrust_deviation: f64,
    /// Greatest deviation of the lag of the thrust \[ms\].
    pub thrust_lag_deviation_ms: f64,
}

impl Default for AdaptationOptions {
    fn default() -> Self {
        Self {
            adapt: true,
            rate_gain_deviation: 0.4,
            rate_lag_deviation_ms: 60.0,
            delay_deviation_ms: 40.0,
            thrust_deviation: 0.4,
            thrust_lag_deviation_ms: 120.0,
        }
    }
}

impl AdaptationOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("rate-gain-deviation", self.rate_gain_deviation, Rule::Between(0.0, 0.9)),
            ("rate-lag-deviation-ms", self.rate_lag_deviation_ms, Rule::Between(0.0, 500.0)),
            ("delay-deviation-ms", self.delay_deviation_ms, Rule::Between(0.0, 100.0)),
            ("thrust-deviation", self.thrust_deviation, Rule::Between(0.0, 0.9)),
            ("thrust-lag-deviation-ms", self.thrust_lag_deviation_ms, Rule::Between(0.0, 500.0)),
        ])
    }
}

/// Options of the [`Autopilot`](super::Autopilot).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct PredictiveOptions {
    /// Corrective velocity per position error, horizontally \[1/s\].
    pub position_gain_per_s: f64,
    /// Corrective velocity per position error, vertically; does not affect the attitude \[1/s\].
    pub vertical_position_gain_per_s: f64,
    /// Corrective acceleration per velocity error, horizontally \[1/s\].
    pub velocity_gain_per_s: f64,
    /// Corrective acceleration per velocity error, vertically \[1/s\]. Its default is lower than the horizontal one, since
    /// a hidden delay of the thrust is not adapted.
    pub vertical_velocity_gain_per_s: f64,
    /// Bandwidth of the filter on the corrective acceleration \[rad/s\].
    pub command_bandwidth_rad_s: f64,
    /// The Kalman filters.
    pub filter: FilterOptions,
    /// Adaptation of the model in flight.
    pub adaptation: AdaptationOptions,
    /// The reference model.
    pub reference: ReferenceModelOptions,
}

impl Default for PredictiveOptions {
    fn default() -> Self {
        // Position gains, command bandwidth and filters: found by an evolution strategy over squares, hovers, chirps and
        // doublets of the nominal vehicle, of one with a fifth less rate authority and of one with a lag of 80 ms, which are
        // among the mismatched plants of Table V, with a reference model that has been replaced since; then by hand, the
        // walk of the acceleration for the hover. Velocity gains: by hand, over the draws of `oqtal robustness --laws
        // oqtal-dt --seed 2` (docs/oqtal-dt.md, "Hover against robustness").
        Self {
            position_gain_per_s: 1.45,
            vertical_position_gain_per_s: 2.5,
            velocity_gain_per_s: 9.0,
            vertical_velocity_gain_per_s: 6.5,
            command_bandwidth_rad_s: 15.0,
            filter: FilterOptions::default(),
            adaptation: AdaptationOptions::default(),
            reference: ReferenceModelOptions::default(),
        }
    }
}

impl PredictiveOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("position-gain-per-s", self.position_gain_per_s, Rule::Between(0.0, 100.0)),
            (
                "vertical-position-gain-per-s",
                self.vertical_position_gain_per_s,
                Rule::Between(0.0, 100.0),
            ),
            ("velocity-gain-per-s", self.velocity_gain_per_s, Rule::Between(0.0, 100.0)),
            (
                "vertical-velocity-gain-per-s",
                self.vertical_velocity_gain_per_s,
                Rule::Between(0.0, 100.0),
            ),
            ("command-bandwidth-rad-s", self.command_bandwidth_rad_s, Rule::Between(0.1, 1000.0)),
        ])?;
        self.filter.check().map_err(|error| error.within("filter"))?;
        self.adaptation.check().map_err(|error| error.within("adaptation"))?;
        self.reference.check().map_err(|error| error.within("reference"))
    }
}
