//! Framing on the serial port of a radio.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Framing on the serial port of a radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Framing {
    /// None: the payload's bytes alone.
    #[default]
    Transparent,
    /// API mode 1: frames without escapes.
    Api1,
    /// API mode 2: frames with special bytes escaped.
    Api2,
}

/// Error in the name of a framing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown framing `{0}`; write transparent, api1 or api2")]
pub struct InvalidFraming(String);

impl Framing {
    const ALL: [Self; 3] = [Self::Transparent, Self::Api1, Self::Api2];

    fn name(self) -> &'static str {
        match self {
            Self::Transparent => "transparent",
            Self::Api1 => "api1",
            Self::Api2 => "api2",
        }
    }
}

impl FromStr for Framing {
    type Err = InvalidFraming;

    fn from_str(text: &str) -> Result<Self, InvalidFraming> {
        let known = Self::ALL.into_iter().find(|framing| framing.name() == text);
        known.ok_or_else(|| InvalidFraming(text.to_owned()))
    }
}

impl fmt::Display for Framing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
