//! What the options of all laws have in common.

use std::fmt;

use serde::{Deserialize, Serialize};

/// An option whose value has no meaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InvalidOption {
    /// The option, as it is written in a configuration file.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// What it should be.
    pub expected: &'static str,
}

impl fmt::Display for InvalidOption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, value, expected } = self;
        write!(f, "{key} = {value}: must be {expected}")
    }
}

impl std::error::Error for InvalidOption {}

impl InvalidOption {
    /// Refuses zero, negative numbers, infinity and NaN.
    pub(super) fn unless_positive(key: &'static str, value: f64) -> Result<(), Self> {
        let valid = value > 0.0 && value.is_finite();
        if valid { Ok(()) } else { Err(Self { key, value, expected: "a finite number above 0" }) }
    }

    /// Refuses negative numbers, infinity and NaN.
    pub(super) fn unless_not_negative(key: &'static str, value: f64) -> Result<(), Self> {
        let valid = value >= 0.0 && value.is_finite();
        if valid {
            Ok(())
        } else {
            Err(Self { key, value, expected: "a finite number, 0 or above" })
        }
    }

    /// Refuses zero, negative numbers and NaN: infinity stands for "no limit".
    pub(super) fn unless_positive_or_infinite(key: &'static str, value: f64) -> Result<(), Self> {
        if value > 0.0 {
            Ok(())
        } else {
            Err(Self { key, value, expected: "above 0, inf for none" })
        }
    }
}

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
