//! The rules that values of the configuration keep, and how a broken one is told.

use oqtal_control::options::OptionError;
use oqtal_wire::link::LinkSpec;

/// A rule that a value breaks.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` {rule}")]
pub struct Violation {
    /// The key, dotted: `vehicle.mass-kg`.
    pub key: String,
    /// The rule.
    pub rule: String,
}

impl Violation {
    /// A violation of `rule` by `key`.
    #[must_use]
    pub fn new(key: impl Into<String>, rule: impl Into<String>) -> Self {
        Self { key: key.into(), rule: rule.into() }
    }
}

/// An option of `section` whose value is not allowed.
pub(crate) fn outside(section: &str, error: OptionError) -> Violation {
    let OptionError { key, value, allowed } = error.within(section);
    Violation::new(key, format!("is {value}, it must be {allowed}"))
}

/// The link that `text`, the value of `key`, names; `None` if it is empty.
pub(crate) fn link_at(key: &str, text: &str) -> Result<Option<LinkSpec>, Violation> {
    if text.is_empty() {
        return Ok(None);
    }
    let refused = |error| Violation::new(key, format!("is no link: {error}"));
    text.parse::<LinkSpec>().map(Some).map_err(refused)
}

/// `value` must be finite and above zero.
pub(crate) fn positive(key: &str, value: f64) -> Result<(), Violation> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(Violation::new(key, format!("must be above zero, is {value}")))
    }
}

/// `value` must be finite and not below zero.
pub(crate) fn not_negative(key: &str, value: f64) -> Result<(), Violation> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(Violation::new(key, format!("must not be negative, is {value}")))
    }
}

/// `value` must lie in 0..=1.
pub(crate) fn probability(key: &str, value: f64) -> Result<(), Violation> {
    if (0.0..=1.0).contains(&value) {
        Ok(())
    } else {
        Err(Violation::new(key, format!("must be between 0 and 1, is {value}")))
    }
}
