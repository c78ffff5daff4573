//! Plausible ranges of options: an option outside its range is a mistake in the configuration, not a choice.

use std::fmt;
use std::ops::RangeInclusive;

/// An option whose value lies outside its range.
#[derive(Clone, Debug, PartialEq)]
pub struct OutOfRange {
    /// The key in the configuration, relative to the table of the options.
    pub key: &'static str,
    /// The value found.
    pub value: f64,
    /// The values allowed.
    pub range: RangeInclusive<f64>,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, value, range } = self;
        write!(f, "{key} is {value}, it must lie between {} and {}", range.start(), range.end())
    }
}

impl std::error::Error for OutOfRange {}

/// Whether `value` is a number in `range`.
pub(crate) fn check_range(
    key: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
) -> Result<(), OutOfRange> {
    if range.contains(&value) { Ok(()) } else { Err(OutOfRange { key, value, range }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_belong_to_the_range_and_nan_to_none() {
        assert_eq!(check_range("a", 1.0, 1.0..=2.0), Ok(()));
        assert_eq!(check_range("a", 2.0, 1.0..=2.0), Ok(()));
        assert!(check_range("a", 2.1, 1.0..=2.0).is_err());
        assert!(check_range("a", f64::NAN, f64::NEG_INFINITY..=f64::INFINITY).is_err());
    }

    #[test]
    fn message_names_key_value_and_range() {
        let error = check_range("tilt-limit-deg", 75.0, 1.0..=60.0).unwrap_err();
        assert_eq!(error.to_string(), "tilt-limit-deg is 75, it must lie between 1 and 60");
    }
}
