//! Rules for the values of options, and the error for an option that breaks its rule.
//!
//! Every options type of this crate has a method `check`, a table of (key, value, rule) given to [`check_options`].

use std::fmt;

/// An option whose value is not allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OptionError {
    /// Dotted key of the option in the configuration, relative to the section that was checked: `filter.rate-walk-rad-s`.
    pub key: String,
    /// The value found, as text.
    pub value: String,
    /// The values allowed, worded to follow "must be": `between 1 and 60`.
    pub allowed: String,
}

impl OptionError {
    /// The error of the option `key`, whose `value` must be `allowed`.
    pub fn new(
        key: impl Into<String>,
        value: impl fmt::Display,
        allowed: impl fmt::Display,
    ) -> Self {
        Self { key: key.into(), value: value.to_string(), allowed: allowed.to_string() }
    }

    /// The same error with the key relative to the parent of `section`: `section` and a dot are put before the key.
    pub fn within(mut self, section: &str) -> Self {
        self.key = format!("{section}.{}", self.key);
        self
    }
}

impl fmt::Display for OptionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, value, allowed } = self;
        write!(f, "`{key}` is {value}, it must be {allowed}")
    }
}

impl std::error::Error for OptionError {}

/// A rule for the value of a numeric option. NaN breaks every rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Finite and above 0.
    Positive,
    /// Finite, 0 or above.
    NotNegative,
    /// Above 0; infinity stands for "no limit".
    PositiveOrInfinite,
    /// Within these bounds, both included \[unit of the option\].
    Between(f64, f64),
}

impl Rule {
    /// Whether `value` satisfies the rule.
    pub fn allows(self, value: f64) -> bool {
        match self {
            Self::Positive => value.is_finite() && value > 0.0,
            Self::NotNegative => value.is_finite() && value >= 0.0,
            Self::PositiveOrInfinite => value > 0.0,
            Self::Between(low, high) => (low..=high).contains(&value),
        }
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Positive => f.write_str("a finite number above 0"),
            Self::NotNegative => f.write_str("a finite number, 0 or above"),
            Self::PositiveOrInfinite => f.write_str("above 0 (inf for no limit)"),
            Self::Between(low, f64::MAX) => write!(f, "at least {}", Figure(low)),
            Self::Between(low, high) => write!(f, "between {} and {}", Figure(low), Figure(high)),
        }
    }
}

/// A number as text, in scientific notation if it would have many digits.
struct Figure(f64);

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            value if value != 0.0 && value.is_finite() && !(1e-6..1e9).contains(&value.abs()) => {
                write!(f, "{value:e}")
            }
            value => write!(f, "{value}"),
        }
    }
}

/// Checks a table of (key, value, rule).
///
/// # Errors
/// The first option whose value breaks its rule.
pub fn check_options<const N: usize>(table: [(&str, f64, Rule); N]) -> Result<(), OptionError> {
    let broken = table.into_iter().find(|(_, value, rule)| !rule.allows(*value));
    broken.map_or(Ok(()), |(key, value, rule)| Err(OptionError::new(key, Figure(value), rule)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_belong_to_the_range_and_nan_to_none() {
        assert!(Rule::Between(1.0, 2.0).allows(1.0));
        assert!(Rule::Between(1.0, 2.0).allows(2.0));
        assert!(!Rule::Between(1.0, 2.0).allows(2.1));
        assert!(!Rule::Between(f64::NEG_INFINITY, f64::INFINITY).allows(f64::NAN));
    }

    #[test]
    fn signs_and_infinity_are_distinguished() {
        let allowed =
            |rule: Rule| [-1.0, 0.0, 1.0, f64::INFINITY, f64::NAN].map(|x| rule.allows(x));
        assert_eq!(allowed(Rule::Positive), [false, false, true, false, false]);
        assert_eq!(allowed(Rule::NotNegative), [false, true, true, false, false]);
        assert_eq!(allowed(Rule::PositiveOrInfinite), [false, false, true, true, false]);
    }

    #[test]
    fn bounds_and_values_are_short() {
        let error = |value, rule| check_options([("x", value, rule)]).unwrap_err().to_string();
        assert_eq!(error(0.0, Rule::Between(1.0, f64::MAX)), "`x` is 0, it must be at least 1");
        assert_eq!(
            error(-1e300, Rule::Between(1e-7, 45.0)),
            "`x` is -1e300, it must be between 1e-7 and 45"
        );
    }

    #[test]
    fn a_message_names_key_value_and_allowed_values() {
        let table =
            [("mass-kg", 0.5, Rule::Positive), ("tilt-limit-deg", 75.0, Rule::Between(1.0, 60.0))];
        let error = check_options(table).unwrap_err().within("position");
        assert_eq!(
            error.to_string(),
            "`position.tilt-limit-deg` is 75, it must be between 1 and 60"
        );
    }
}
