//! How a radio frames what it carries.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// How a radio frames what it carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Framing {
    /// Not at all.
    #[default]
    Transparent,
    /// API mode 1: frames.
    Api1,
    /// API mode 2: frames whose special bytes are escaped.
    Api2,
}

/// Text that is no framing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown framing `{0}`, know transparent, api1, api2")]
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
