//! Text form of a link to a vehicle: the language that is spoken there, the port, and options: `LANGUAGE:PORT[,KEY=VALUE]…`.
//!
//! | file | subject |
//! |---|---|
//! | `port.rs`, `radio.rs` | ports: serial, UDP, TCP, Crazyradio |
//! | `options.rs` | the options behind a port |
//! | `asctec.rs`, `mavlink.rs`, `crtp.rs` | the link of one language; a further language is a file like these, and a variant of [`LinkSpec`] |

mod asctec;
mod crtp;
mod mavlink;
mod options;
mod port;
mod radio;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use asctec::AsctecLink;
pub use crtp::CrtpLink;
pub use mavlink::{AutopilotKind, MavlinkLink};
pub use port::{HostPort, PortSpec, SerialSpec};
pub use radio::{RadioRate, RadioSpec};

/// Link to a vehicle: language, port, options.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum LinkSpec {
    /// AscTec's serial interface, [`crate::asctec`].
    Asctec(AsctecLink),
    /// MAVLink 2.
    Mavlink(MavlinkLink),
    /// CRTP, [`crate::crtp`].
    Crtp(CrtpLink),
}

/// Form of the links of one language, and their parser.
type LinkParser = fn(&str) -> Result<LinkSpec, String>;

/// The languages: name, form, parser of what stands behind the name.
const LANGUAGES: [(&str, &str, LinkParser); 3] = [
    ("asctec", AsctecLink::FORM, |rest| AsctecLink::parse(rest).map(LinkSpec::Asctec)),
    ("mavlink", MavlinkLink::FORM, |rest| MavlinkLink::parse(rest).map(LinkSpec::Mavlink)),
    ("crtp", CrtpLink::FORM, |rest| CrtpLink::parse(rest).map(LinkSpec::Crtp)),
];

impl LinkSpec {
    /// Parses a configuration value; `None` if it is empty.
    ///
    /// # Errors
    /// The text is no link.
    pub fn from_setting(text: &str) -> Result<Option<Self>, InvalidLink> {
        if text.is_empty() { Ok(None) } else { text.parse().map(Some) }
    }

    /// The forms of all links, one for each language.
    #[must_use]
    pub fn forms() -> Vec<&'static str> {
        LANGUAGES.iter().map(|(_, form, _)| *form).collect()
    }

    /// Name of the language.
    #[must_use]
    pub fn language(&self) -> &'static str {
        match self {
            Self::Asctec(_) => "asctec",
            Self::Mavlink(_) => "mavlink",
            Self::Crtp(_) => "crtp",
        }
    }

    /// The link without its port: language and options.
    #[must_use]
    pub fn kind(&self) -> String {
        let port = match self {
            Self::Asctec(link) => link.serial.path.clone(),
            Self::Mavlink(link) => link.port.to_string(),
            Self::Crtp(link) => link.to_string(),
        };
        self.to_string().replacen(&format!(":{port}"), "", 1)
    }

    /// The port.
    #[must_use]
    pub fn port(&self) -> PortSpec {
        match self {
            Self::Asctec(link) => PortSpec::Serial(link.serial.clone()),
            Self::Mavlink(link) => link.port.clone(),
            Self::Crtp(link) => link.port(),
        }
    }
}

/// Error in the text of a link.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("link `{text}`: {problem}; write {form}")]
pub struct InvalidLink {
    /// Text that is no link.
    pub text: String,
    /// Part of it that is wrong.
    pub problem: String,
    /// Form of a link in this language, or the forms of all languages.
    pub form: String,
}

impl FromStr for LinkSpec {
    type Err = InvalidLink;

    fn from_str(text: &str) -> Result<Self, InvalidLink> {
        let refused = |problem: String, form: String| {
            let text = text.to_owned();
            InvalidLink { text, problem, form }
        };
        let all = || Self::forms().join(" or ");
        let (name, rest) = text
            .split_once(':')
            .ok_or_else(|| refused("no kind before a colon".to_owned(), all()))?;
        let language = LANGUAGES.iter().find(|(known, ..)| *known == name);
        let (_, form, parse) =
            language.ok_or_else(|| refused(format!("unknown kind `{name}`"), all()))?;
        parse(rest).map_err(|problem| refused(problem, (*form).to_owned()))
    }
}

impl fmt::Display for LinkSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Asctec(link) => write!(f, "asctec:{link}"),
            Self::Mavlink(link) => write!(f, "mavlink:{link}"),
            Self::Crtp(link) => write!(f, "crtp:{link}"),
        }
    }
}

impl TryFrom<String> for LinkSpec {
    type Error = InvalidLink;

    fn try_from(text: String) -> Result<Self, InvalidLink> {
        text.parse()
    }
}

impl From<LinkSpec> for String {
    fn from(link: LinkSpec) -> Self {
        link.to_string()
    }
}

#[cfg(test)]
mod tests;
