//! The rate that a law feeds back.

use serde::{Deserialize, Serialize};

/// Rate fed back by a law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RateFeedback {
    /// The body rate, as printed in the paper for the classic LQR and the PID. Such a law lags behind a turning
    /// reference.
    #[default]
    Omega,
    /// The body rate relative to the desired rate, as always in OQTAL. Not in the paper for the other laws.
    OmegaE,
}
