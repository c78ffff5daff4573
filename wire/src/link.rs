//! Text forms of links: the kind, the address and options: `KIND:ADDRESS[,KEY=VALUE]…`.
//!
//! | file | subject |
//! |---|---|
//! | `text.rs` | the grammar, and its errors |
//! | `port.rs`, `radio.rs` | ports: serial, UDP, TCP, Crazyradio |
//! | `asctec.rs`, `mavlink.rs`, `crtp.rs`, `msp.rs` | links to vehicles; a further protocol is a file like these, and a variant of [`LinkSpec`] |
//! | `camera.rs` | links to camera systems |
//! | `truth.rs` | links to the true motion of a firmware that runs as a program |

mod asctec;
mod camera;
mod crtp;
mod mavlink;
mod msp;
mod port;
mod radio;
mod text;
mod truth;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use asctec::AsctecLink;
pub use camera::{BodyRoute, CameraLink, CameraProtocol, MAX_BODIES, NatnetDelivery};
pub use crtp::CrtpLink;
pub use mavlink::{AutopilotKind, MavlinkLink};
pub use msp::MspLink;
pub use port::{HostPort, PortSpec, SerialSpec};
pub use radio::{RadioRate, RadioSpec};
pub use text::{InvalidLink, LinkText};
pub use truth::TruthSource;

use text::LinkKind;

/// Link to a vehicle: protocol, port, options.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum LinkSpec {
    /// AscTec's serial interface, [`crate::asctec`].
    Asctec(AsctecLink),
    /// MAVLink 2.
    Mavlink(MavlinkLink),
    /// CRTP, [`crate::crtp`].
    Crtp(CrtpLink),
    /// MSP, [`crate::msp`].
    Msp(MspLink),
}

/// Kinds of links to vehicles.
const KINDS: [LinkKind<LinkSpec>; 4] = [
    LinkKind {
        name: "asctec",
        form: AsctecLink::FORM,
        parse: |path, link| AsctecLink::parse(path, link).map(LinkSpec::Asctec),
    },
    LinkKind {
        name: "mavlink",
        form: MavlinkLink::FORM,
        parse: |port, link| MavlinkLink::parse(port, link).map(LinkSpec::Mavlink),
    },
    LinkKind {
        name: "crtp",
        form: CrtpLink::FORM,
        parse: |port, link| CrtpLink::parse(port, link).map(LinkSpec::Crtp),
    },
    LinkKind {
        name: "msp",
        form: MspLink::FORM,
        parse: |port, link| MspLink::parse(port, link).map(LinkSpec::Msp),
    },
];

impl LinkSpec {
    /// Parses a link without a port, `KIND[,KEY=VALUE]…`; the port of the link is a placeholder.
    ///
    /// # Errors
    /// The kind is unknown, or an option is wrong.
    pub fn without_port(text: &str) -> Result<Self, InvalidLink> {
        let (kind, options) = text.split_at(text.find(',').unwrap_or(text.len()));
        let port = match kind {
            "asctec" => "/",
            "crtp" => "udp:127.0.0.1:19850",
            _ => "udpin:127.0.0.1:14550",
        };
        format!("{kind}:{port}{options}").parse()
    }

    /// Forms of all links, one for each kind.
    pub fn forms() -> Vec<&'static str> {
        KINDS.iter().map(|kind| kind.form).collect()
    }

    /// Name of the kind, address and text of the options.
    fn parts(&self) -> (&'static str, String, String) {
        match self {
            Self::Asctec(link) => ("asctec", link.serial.path.clone(), link.options()),
            Self::Mavlink(link) => ("mavlink", link.port.to_string(), link.options()),
            Self::Crtp(link) => ("crtp", link.to_string(), String::new()),
            Self::Msp(link) => ("msp", link.port.to_string(), link.options()),
        }
    }

    /// The link without its port: kind and options.
    pub fn kind(&self) -> String {
        let (kind, _, options) = self.parts();
        kind.to_owned() + &options
    }

    /// The port.
    pub fn port(&self) -> PortSpec {
        match self {
            Self::Asctec(link) => PortSpec::Serial(link.serial.clone()),
            Self::Mavlink(link) => link.port.clone(),
            Self::Crtp(link) => link.port(),
            Self::Msp(link) => link.port.clone(),
        }
    }
}

impl FromStr for LinkSpec {
    type Err = InvalidLink;

    fn from_str(text: &str) -> Result<Self, InvalidLink> {
        text::parse("link", text, &KINDS)
    }
}

impl fmt::Display for LinkSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, address, options) = self.parts();
        write!(f, "{kind}:{address}{options}")
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
