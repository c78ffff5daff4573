//! Links to camera systems: `KIND:HOST[:PORT],body=NAME[@INSTANCE]…` with the options of the kind.

use std::fmt;
use std::net::Ipv4Addr;
use std::str::FromStr;

use super::port::HostPort;
use super::text::{self, InvalidLink, LinkKind, LinkText, option};
use crate::qtm::QtmVersion;
use crate::{natnet, qtm, vrpn};

/// Version of QTM's protocol without the option `version` \[-\].
const DEFAULT_QTM_VERSION: u8 = 25;
/// Longest name of a body \[bytes\].
const MAX_NAME_BYTES: usize = 255;
/// Greatest number of bodies of one link \[-\].
pub const MAX_BODIES: usize = 64;

/// Protocol of a camera system, with its options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraProtocol {
    /// QTM RT of Qualisys.
    Qtm {
        /// Whether frames come as datagrams, not over the control connection.
        udp: bool,
        /// Version of the protocol: 25 for 1.25 \[-\].
        minor: u8,
    },
    /// VRPN of Vicon Tracker, Motive and others.
    Vrpn,
    /// NatNet of OptiTrack Motive.
    Natnet {
        /// Delivery of the frames.
        delivery: NatnetDelivery,
    },
}

/// Delivery of the frames of NatNet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NatnetDelivery {
    /// Delivery by the server's own setting: to its multicast group, or to this client.
    #[default]
    Announced,
    /// Delivery to this multicast group.
    Multicast(Ipv4Addr),
    /// Delivery to this client by unicast.
    Unicast,
}

/// Body of a camera system, and the instance that receives its poses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BodyRoute {
    /// Name, or number, of the body in the camera system.
    pub name: String,
    /// Instance; `None` for the one of the configuration.
    pub instance: Option<String>,
}

/// Link to a camera system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraLink {
    /// Protocol and its options.
    pub protocol: CameraProtocol,
    /// Name or address of the server; an IPv6 address without brackets.
    pub host: String,
    /// Port of the server \[-\].
    pub port: u16,
    /// Bodies that are received; empty for a link without bodies.
    pub bodies: Vec<BodyRoute>,
}

/// Kinds of camera systems.
const KINDS: [LinkKind<CameraLink>; 3] = [
    LinkKind {
        name: "qtm",
        form: "qtm:HOST[:PORT],body=NAME[@INSTANCE][,transport=udp|tcp][,version=1.25], several bodies by several body=",
        parse: |host, link| CameraLink::parse(parse_qtm(link)?, host, link),
    },
    LinkKind {
        name: "vrpn",
        form: "vrpn:HOST[:PORT],body=NAME[@INSTANCE], several bodies by several body=",
        parse: |host, link| CameraLink::parse(CameraProtocol::Vrpn, host, link),
    },
    LinkKind {
        name: "natnet",
        form: "natnet:HOST[:PORT],body=NAME|ID[@INSTANCE][,multicast=ADDR|unicast], several bodies by several body=",
        parse: |host, link| CameraLink::parse(parse_natnet(link)?, host, link),
    },
];

impl CameraProtocol {
    /// Kind of its links.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qtm { .. } => "qtm",
            Self::Vrpn => "vrpn",
            Self::Natnet { .. } => "natnet",
        }
    }

    /// Default port of a server \[-\]: of QTM the one for little endian, of NatNet the one for commands.
    pub const fn default_port(self) -> u16 {
        match self {
            Self::Qtm { .. } => qtm::LITTLE_ENDIAN_PORT,
            Self::Vrpn => vrpn::VRPN_PORT,
            Self::Natnet { .. } => natnet::COMMAND_PORT,
        }
    }

    /// Text of the options.
    fn options(self) -> String {
        match self {
            Self::Qtm { udp, minor } => {
                let version = Some(minor).filter(|minor| *minor != DEFAULT_QTM_VERSION);
                option("transport", (!udp).then_some("tcp"))
                    + &option("version", version.map(|minor| format!("1.{minor}")))
            }
            Self::Natnet { delivery: NatnetDelivery::Unicast } => ",unicast".to_owned(),
            Self::Natnet { delivery: NatnetDelivery::Multicast(group) } => {
                option("multicast", Some(group))
            }
            Self::Vrpn | Self::Natnet { delivery: NatnetDelivery::Announced } => String::new(),
        }
    }
}

fn parse_qtm(link: &mut LinkText<'_>) -> Result<CameraProtocol, String> {
    let udp = match link.take("transport")? {
        None | Some("udp") => true,
        Some("tcp") => false,
        Some(value) => return Err(format!("transport `{value}` is neither udp nor tcp")),
    };
    let minor = link.take("version")?.map_or(Ok(DEFAULT_QTM_VERSION), parse_version)?;
    Ok(CameraProtocol::Qtm { udp, minor })
}

fn parse_version(text: &str) -> Result<u8, String> {
    let minor = text.strip_prefix("1.").and_then(|minor| minor.parse().ok());
    minor.filter(|minor| QtmVersion::new(1, *minor).is_supported()).ok_or_else(|| {
        let (oldest, newest) = (QtmVersion::OLDEST, QtmVersion::NEWEST);
        format!("version `{text}` is not between {oldest} and {newest}")
    })
}

fn parse_natnet(link: &mut LinkText<'_>) -> Result<CameraProtocol, String> {
    let delivery = match (link.take_flag("unicast")?, link.take("multicast")?) {
        (true, Some(_)) => return Err("both `unicast` and `multicast`".to_owned()),
        (true, None) => NatnetDelivery::Unicast,
        (false, Some(group)) => NatnetDelivery::Multicast(parse_group(group)?),
        (false, None) => NatnetDelivery::Announced,
    };
    Ok(CameraProtocol::Natnet { delivery })
}

fn parse_group(text: &str) -> Result<Ipv4Addr, String> {
    let group = text.parse().ok().filter(Ipv4Addr::is_multicast);
    group.ok_or_else(|| format!("`{text}` is not a multicast address"))
}

impl CameraLink {
    /// Parses host and port, and takes the bodies.
    fn parse(
        protocol: CameraProtocol,
        host: &str,
        link: &mut LinkText<'_>,
    ) -> Result<Self, String> {
        let HostPort { host, port } = HostPort::parse(host, Some(protocol.default_port()))?;
        let host = match host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            Some(address) => address.to_owned(),
            None => host,
        };
        let bodies = link.take_all("body")?.into_iter().map(parse_body);
        let bodies = bodies.collect::<Result<Vec<_>, _>>()?;
        check_bodies(&bodies)?;
        Ok(Self { protocol, host, port, bodies })
    }
}

impl FromStr for CameraLink {
    type Err = InvalidLink;

    fn from_str(text: &str) -> Result<Self, InvalidLink> {
        text::parse("link", text, &KINDS)
    }
}

/// Parses `NAME` or `NAME@INSTANCE`; an `@` that is not followed by the name of an instance belongs to the name of the body.
fn parse_body(text: &str) -> Result<BodyRoute, String> {
    let route = match text.rsplit_once('@') {
        Some((name, instance)) if is_instance(instance) => {
            BodyRoute { name: name.to_owned(), instance: Some(instance.to_owned()) }
        }
        _ => BodyRoute { name: text.to_owned(), instance: None },
    };
    match route.name.len() {
        0 => Err("a body without a name".to_owned()),
        1..=MAX_NAME_BYTES => Ok(route),
        length => Err(format!("a name of {length} bytes, more than {MAX_NAME_BYTES}")),
    }
}

fn is_instance(text: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    (1..=32).contains(&text.len()) && text.chars().all(allowed)
}

fn check_bodies(bodies: &[BodyRoute]) -> Result<(), String> {
    if bodies.len() > MAX_BODIES {
        return Err(format!("{} bodies are more than {MAX_BODIES}", bodies.len()));
    }
    for (index, body) in bodies.iter().enumerate() {
        let earlier = &bodies[..index];
        if earlier.iter().any(|other| other.name == body.name) {
            return Err(format!("body `{}` twice", body.name));
        }
        if earlier.iter().any(|other| other.instance == body.instance) {
            let which = body.instance.as_deref().unwrap_or("of the configuration");
            return Err(format!("two bodies for the instance {which}"));
        }
    }
    Ok(())
}

impl fmt::Display for CameraLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (open, close) = if self.host.contains(':') { ("[", "]") } else { ("", "") };
        write!(f, "{}:{open}{}{close}", self.protocol.name(), self.host)?;
        if self.port != self.protocol.default_port() {
            write!(f, ":{}", self.port)?;
        }
        for BodyRoute { name, instance } in &self.bodies {
            let instance = instance.as_ref().map_or_else(String::new, |name| format!("@{name}"));
            write!(f, ",body={name}{instance}")?;
        }
        f.write_str(&self.protocol.options())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn every_form_is_read_and_written_back() {
        for text in [
            "qtm:192.168.0.2,body=Hummingbird",
            "qtm:cameras:22224,body=a@one,body=b c@two,transport=tcp,version=1.20",
            "vrpn:[fe80::1]:3884,body=Object 1",
            "natnet:10.0.0.5,body=7@seven,multicast=239.255.42.98",
            "natnet:10.0.0.5,body=cf@home@default,unicast",
            "qtm:cameras",
        ] {
            let link: CameraLink = text.parse().unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(link.to_string(), text);
        }
        let link: CameraLink = "natnet:h,body=cf@home@default".parse().unwrap();
        assert_eq!(link.bodies[0].name, "cf@home");
        assert_eq!(link.port, 1510);
    }

    #[test]
    fn errors_name_the_problem_and_the_form() {
        for (text, problem) in [
            ("10.0.0.1", "no kind"),
            ("vicon:10.0.0.1", "unknown kind `vicon`"),
            ("qtm:", "no host"),
            ("qtm:h:0", "port `0`"),
            ("qtm:h:70000", "port `70000`"),
            ("vrpn:[::1]x", "text after the address"),
            ("qtm:h,transport=sctp", "neither udp nor tcp"),
            ("qtm:h,version=1.7", "not between 1.8 and 1.28"),
            ("qtm:h,version=2.0", "version `2.0`"),
            ("qtm:h,version=1.20,version=1.21", "`version` twice"),
            ("qtm:h,body=", "a body without a name"),
            ("qtm:h,body=@one", "a body without a name"),
            ("vrpn:h,transport=udp", "unknown option `transport` of vrpn"),
            ("natnet:h,unicast,multicast=239.255.42.98", "both `unicast` and `multicast`"),
            ("natnet:h,multicast=10.0.0.1", "not a multicast address"),
            ("vrpn:h,body=a@x,body=a@y", "body `a` twice"),
            ("vrpn:h,body=a@x,body=b@x", "two bodies for the instance x"),
            ("vrpn:h,body=a,body=b", "two bodies for the instance of the configuration"),
        ] {
            let message = text.parse::<CameraLink>().unwrap_err().to_string();
            assert!(message.contains(problem) && message.contains("body=NAME"), "{message}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_link_or_refused(text in "(qtm|vrpn|natnet):.*") {
            if let Ok(link) = text.parse::<CameraLink>() {
                prop_assert_eq!(link.to_string().parse::<CameraLink>(), Ok(link));
            }
        }
    }
}
