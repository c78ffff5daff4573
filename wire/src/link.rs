//! Text form of a link to a vehicle: `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::xbee::Framing;

/// Text form, for error messages.
const FORM: &str = "asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]";
/// Allowed speeds of a serial port \[baud\].
const BAUD: RangeInclusive<u32> = 1200..=3_000_000;
/// Default speed, AscTec's \[baud\].
const DEFAULT_BAUD: u32 = 57_600;

/// Wire format of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProtocolKind {
    /// [`crate::asctec`].
    Asctec,
}

impl ProtocolKind {
    const ALL: [(&'static str, Self); 1] = [("asctec", Self::Asctec)];

    fn name(self) -> &'static str {
        match self {
            Self::Asctec => "asctec",
        }
    }
}

/// Link to a vehicle: wire format, serial port, framing of the radio.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct LinkSpec {
    kind: ProtocolKind,
    path: String,
    baud: u32,
    xbee: Framing,
}

impl LinkSpec {
    /// Parses a configuration value; `None` if it is empty.
    ///
    /// # Errors
    /// The text is no link.
    pub fn from_setting(text: &str) -> Result<Option<Self>, InvalidLink> {
        if text.is_empty() { Ok(None) } else { text.parse().map(Some) }
    }

    /// Wire format of the vehicle.
    #[must_use]
    pub fn kind(&self) -> ProtocolKind {
        self.kind
    }

    /// Path of the serial port.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Speed of the serial port \[baud\].
    #[must_use]
    pub fn baud(&self) -> u32 {
        self.baud
    }

    /// Framing of the radio.
    #[must_use]
    pub fn xbee(&self) -> Framing {
        self.xbee
    }
}

/// Error in the text of a link.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("link `{text}`: {problem}; write {FORM}")]
pub struct InvalidLink {
    /// Text that is no link.
    pub text: String,
    /// Part of it that is wrong.
    pub problem: String,
}

impl FromStr for LinkSpec {
    type Err = InvalidLink;

    fn from_str(text: &str) -> Result<Self, InvalidLink> {
        parse(text).map_err(|problem| InvalidLink { text: text.to_owned(), problem })
    }
}

fn parse(text: &str) -> Result<LinkSpec, String> {
    let (name, rest) = text.split_once(':').ok_or("no kind before a colon")?;
    let kind =
        ProtocolKind::ALL.into_iter().find_map(|(known, kind)| (known == name).then_some(kind));
    let kind = kind.ok_or_else(|| format!("unknown kind `{name}`"))?;
    let mut parts = rest.split(',');
    let path = parts.next().unwrap_or_default();
    if path.is_empty() {
        return Err("no path of a serial port".to_owned());
    }
    let (mut baud, mut xbee) = (None, None);
    for part in parts {
        let (key, value) = part.split_once('=').ok_or_else(|| format!("`{part}` has no `=`"))?;
        let twice = match key {
            "baud" => baud.replace(parse_baud(value)?).is_some(),
            "xbee" => {
                xbee.replace(value.parse::<Framing>().map_err(|error| error.to_string())?).is_some()
            }
            _ => return Err(format!("unknown option `{key}`")),
        };
        if twice {
            return Err(format!("`{key}` twice"));
        }
    }
    let (baud, xbee) = (baud.unwrap_or(DEFAULT_BAUD), xbee.unwrap_or_default());
    Ok(LinkSpec { kind, path: path.to_owned(), baud, xbee })
}

fn parse_baud(value: &str) -> Result<u32, String> {
    let baud = value.parse().ok().filter(|baud| BAUD.contains(baud));
    baud.ok_or_else(|| format!("baud `{value}` is not between {} and {}", BAUD.start(), BAUD.end()))
}

impl fmt::Display for LinkSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.kind.name(), self.path)?;
        if self.baud != DEFAULT_BAUD {
            write!(f, ",baud={}", self.baud)?;
        }
        if self.xbee != Framing::default() {
            write!(f, ",xbee={}", self.xbee)?;
        }
        Ok(())
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
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn refused(text: &str) -> String {
        text.parse::<LinkSpec>().unwrap_err().to_string()
    }

    #[test]
    fn a_port_alone_is_57600_baud_and_transparent() {
        let link: LinkSpec = "asctec:/dev/ttyUSB0".parse().unwrap();
        assert_eq!((link.kind(), link.path()), (ProtocolKind::Asctec, "/dev/ttyUSB0"));
        assert_eq!((link.baud(), link.xbee()), (57_600, Framing::Transparent));
    }

    #[test]
    fn a_colon_in_the_path_belongs_to_the_path() {
        let path = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0";
        let link: LinkSpec = format!("asctec:{path},xbee=api2").parse().unwrap();
        assert_eq!((link.path(), link.xbee()), (path, Framing::Api2));
    }

    #[test]
    fn a_refusal_says_what_is_wrong_and_shows_the_form() {
        for (text, problem) in [
            ("/dev/ttyUSB0", "no kind before a colon"),
            ("mavlink:/dev/ttyUSB0", "unknown kind `mavlink`"),
            ("asctec:", "no path"),
            ("asctec:,baud=57600", "no path"),
            ("asctec:/dev/ttyS0,baud", "`baud` has no `=`"),
            ("asctec:/dev/ttyS0,baud=1199", "not between 1200 and 3000000"),
            ("asctec:/dev/ttyS0,baud=3000001", "not between 1200 and 3000000"),
            ("asctec:/dev/ttyS0,baud=fast", "baud `fast`"),
            ("asctec:/dev/ttyS0,xbee=api3", "`api3`"),
            ("asctec:/dev/ttyS0,parity=even", "unknown option `parity`"),
            ("asctec:/dev/ttyS0,baud=9600,baud=9600", "`baud` twice"),
        ] {
            let message = refused(text);
            assert!(message.contains(problem), "{text}: {message}");
            assert!(message.contains(FORM) && message.contains(text), "{message}");
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(path in "[^,]+", baud in BAUD, xbee in 0..3_usize) {
            let xbee = [Framing::Transparent, Framing::Api1, Framing::Api2][xbee];
            let link = LinkSpec { kind: ProtocolKind::Asctec, path, baud, xbee };
            prop_assert_eq!(link.to_string().parse::<LinkSpec>(), Ok(link));
        }

        #[test]
        fn any_text_is_a_link_or_refused(text: String) {
            if let Ok(link) = text.parse::<LinkSpec>() {
                prop_assert_eq!(link.to_string().parse::<LinkSpec>(), Ok(link));
            }
        }
    }
}
