//! Error of a configuration, with its reason and origin.

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
