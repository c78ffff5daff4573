//! The rate that a law feeds back.

use serde::{Deserialize, Serialize};

/// Which rate a law feeds back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RateFeedback {
    /// The body rate, as the paper prints the rivals of its law. They lag behind a turning
    /// reference.
    #[default]
    Omega,
    /// The body rate relative to the desired rate. Not in the paper for the rivals; always so in
    /// OQTAL.
    OmegaE,
}
