//! `[external]`: a law outside the daemon; `[envelope]`: where commands must not lead.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// `[external]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ExternalOptions {
    /// Time for an answer \[us\].
    pub budget_us: f64,
    /// Good answers in a row after which a law that failed flies again \[-\]; 0: only by an operator's request.
    pub return_answers: u32,
}

impl ExternalOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([("budget-us", self.budget_us, Rule::Between(10.0, 1e6))])
            .map_err(|error| error.within("external"))
    }
}

/// `[envelope]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EnvelopeOptions {
    /// Horizon of the prediction \[ms\].
    pub horizon_ms: f64,
    /// Greatest predicted tilt \[deg\].
    pub tilt_deg: f64,
    /// Greatest predicted body rate \[rad/s\].
    pub rate_rad_s: f64,
    /// Greatest predicted speed \[m/s\].
    pub speed_m_s: f64,
    /// Least distance from the fence, and from the floor, at which the vehicle comes to rest \[m\].
    pub fence_margin_m: f64,
}

impl EnvelopeOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("horizon-ms", self.horizon_ms, Rule::Between(1.0, 1000.0)),
            ("tilt-deg", self.tilt_deg, Rule::Between(1.0, 80.0)),
            ("rate-rad-s", self.rate_rad_s, Rule::Positive),
            ("speed-m-s", self.speed_m_s, Rule::Positive),
            ("fence-margin-m", self.fence_margin_m, Rule::NotNegative),
        ])
        .map_err(|error| error.within("envelope"))
    }
}
