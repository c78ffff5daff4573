//! Versions of the protocol.

use std::fmt;
use std::str::FromStr;

/// Version of the RT protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct QtmVersion {
    /// Major number \[-\].
    pub major: u8,
    /// Minor number \[-\].
    pub minor: u8,
}

impl QtmVersion {
    /// Version of a connection whose client sends none.
    pub const INITIAL: Self = Self::new(1, 1);
    /// Oldest version whose data are of 32 bits, and therefore the oldest supported one.
    pub const OLDEST: Self = Self::new(1, 8);
    /// First version with parameters of the second generation.
    pub const NEW_PARAMETERS: Self = Self::new(1, 21);
    /// Newest supported version.
    pub const NEWEST: Self = Self::new(1, 28);

    /// The version `major.minor`.
    pub const fn new(major: u8, minor: u8) -> Self {
        Self { major, minor }
    }

    /// Whether both ends of this crate support the version.
    pub fn is_supported(self) -> bool {
        (Self::OLDEST..=Self::NEWEST).contains(&self)
    }
}

impl fmt::Display for QtmVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// Error in the text of a version.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a version of the RT protocol; write 1.25, for example")]
pub struct InvalidQtmVersion(String);

impl FromStr for QtmVersion {
    type Err = InvalidQtmVersion;

    fn from_str(text: &str) -> Result<Self, InvalidQtmVersion> {
        let numbers = text
            .split_once('.')
            .and_then(|(major, minor)| Some(Self::new(major.parse().ok()?, minor.parse().ok()?)));
        numbers.ok_or_else(|| InvalidQtmVersion(text.to_owned()))
    }
}
