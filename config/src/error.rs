//! Error of a configuration, with its reason and origin.

use oqtal_control::options::OptionError;

/// A configuration that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{origin}: {reason}")]
pub struct ConfigError {
    /// Origin of the offending value: `FILE:LINE`, the name of the variable, the flag, or `built-in`; the file alone if it cannot
    /// be read.
    pub origin: String,
    /// Reason, on one line.
    pub reason: String,
}

/// An [`OptionError`], with the other options in the broken rule.
#[derive(Debug)]
pub(crate) struct BrokenRule {
    /// The option that breaks the rule, with its full key.
    pub(crate) error: OptionError,
    /// Full keys of the other options in the rule.
    pub(crate) others: &'static [&'static str],
}

impl From<OptionError> for BrokenRule {
    fn from(error: OptionError) -> Self {
        Self { error, others: &[] }
    }
}
