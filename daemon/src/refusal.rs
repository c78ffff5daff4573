//! Refusal of a change of a flight, with its reason.

use oqtal_bus::code::Cause;
use oqtal_config::ConfigError;
use oqtal_runtime::process::Failure;

/// Refusal of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Cause.
    pub cause: Cause,
    /// Reason, with the key at fault; empty if the cause says it.
    pub reason: String,
}

impl Refusal {
    pub(crate) fn of_setting(reason: impl ToString) -> Self {
        Self { cause: Cause::Setting, reason: reason.to_string() }
    }
}

impl From<ConfigError> for Refusal {
    fn from(error: ConfigError) -> Self {
        Self::of_setting(error)
    }
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        Self::of_setting(failure.message)
    }
}
