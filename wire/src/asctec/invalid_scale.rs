//! The error of a scale that breaks a rule.

/// Error in a scale.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} {rule}")]
pub struct InvalidScale {
    /// Key in the configuration, relative to the table of the scales.
    pub key: &'static str,
    /// Rule that the value breaks.
    pub rule: String,
}

impl InvalidScale {
    pub(super) fn new(key: &'static str, rule: impl Into<String>) -> Self {
        Self { key, rule: rule.into() }
    }
}
