//! Text form of a link to a camera system: `KIND:HOST[:PORT],body=NAME[@INSTANCE]...` with the options of the kind.

use std::fmt;
use std::str::FromStr;

/// Text forms, for error messages.
pub const FORMS: &str = "qtm:HOST[:PORT],body=NAME[@INSTANCE][,transport=udp|tcp][,version=1.25], \
     vrpn:HOST[:PORT],body=NAME[@INSTANCE] or \
     natnet:HOST[:PORT],body=NAME|ID[@INSTANCE][,multicast=ADDR|unicast]; several bodies by several body=";
/// Versions of the protocol of QTM that are spoken, the oldest first.
pub const QTM_VERSIONS: [u8; 2] = [8, 28];
/// Longest name of a body \[bytes\].
const MAX_NAME_BYTES: usize = 255;
/// Most bodies of one link.
pub const MAX_BODIES: usize = 64;

/// Protocol of a camera system, with its options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraProtocol {
    /// QTM RT of Qualisys.
    Qtm {
        /// Whether frames come as datagrams; by the connection itself otherwise.
        udp: bool,
        /// The number after the dot of the version: 25 for 1.25.
        minor: u8,
    },
    /// VRPN of Vicon Tracker, Motive and others.
    Vrpn,
    /// NatNet of OptiTrack Motive.
    Natnet {
        /// How frames come.
        delivery: NatnetDelivery,
    },
}

/// Delivery of the frames of NatNet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NatnetDelivery {
    /// As the server says, to its multicast group or to us.
    #[default]
    Announced,
    /// To this multicast group.
    Multicast(std::net::Ipv4Addr),
    /// To us.
    Unicast,
}

/// A body and the instance that its poses go to.
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
    /// Name or address of the server.
    pub host: String,
    /// Port of the server.
    pub port: u16,
    /// Bodies that are received; none for a link that is only looked at.
    pub bodies: Vec<BodyRoute>,
}

/// Error in the text of a link.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("link `{text}`: {problem}; write {FORMS}")]
pub struct InvalidCameraLink {
    /// Text that is no link.
    pub text: String,
    /// Part of it that is wrong.
    pub problem: String,
}

impl CameraProtocol {
    /// The word before the colon.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qtm { .. } => "qtm",
            Self::Vrpn => "vrpn",
            Self::Natnet { .. } => "natnet",
        }
    }

    /// The port that is meant if none is given: of QTM that of little endian, of NatNet that of commands.
    #[must_use]
    pub const fn default_port(self) -> u16 {
        match self {
            Self::Qtm { .. } => 22223,
            Self::Vrpn => 3883,
            Self::Natnet { .. } => 1510,
        }
    }

    fn of_name(name: &str) -> Option<Self> {
        [
            Self::Qtm { udp: true, minor: 25 },
            Self::Vrpn,
            Self::Natnet { delivery: NatnetDelivery::Announced },
        ]
        .into_iter()
        .find(|protocol| protocol.name() == name)
    }

    fn set(&mut self, option: &str) -> Result<(), String> {
        match (self, option.split_once('=').unwrap_or((option, ""))) {
            (Self::Qtm { udp, .. }, ("transport", value)) => {
                *udp = match value {
                    "udp" => true,
                    "tcp" => false,
                    _ => return Err(format!("transport `{value}` is neither udp nor tcp")),
                };
            }
            (Self::Qtm { minor, .. }, ("version", value)) => *minor = parse_version(value)?,
            (Self::Natnet { delivery }, ("unicast", "")) => *delivery = NatnetDelivery::Unicast,
            (Self::Natnet { delivery }, ("multicast", value)) => {
                let group: Option<std::net::Ipv4Addr> = value.parse().ok();
                let group = group.filter(std::net::Ipv4Addr::is_multicast);
                let group = group.ok_or_else(|| format!("`{value}` is no multicast address"))?;
                *delivery = NatnetDelivery::Multicast(group);
            }
            (protocol, (key, _)) => {
                return Err(format!("`{key}` is no option of {}", protocol.name()));
            }
        }
        Ok(())
    }
}

fn parse_version(text: &str) -> Result<u8, String> {
    let [oldest, newest] = QTM_VERSIONS;
    let minor = text.strip_prefix("1.").and_then(|minor| minor.parse().ok());
    minor
        .filter(|minor| (oldest..=newest).contains(minor))
        .ok_or_else(|| format!("version `{text}` is not between 1.{oldest} and 1.{newest}"))
}

impl FromStr for CameraLink {
    type Err = InvalidCameraLink;

    fn from_str(text: &str) -> Result<Self, InvalidCameraLink> {
        parse(text).map_err(|problem| InvalidCameraLink { text: text.to_owned(), problem })
    }
}

fn parse(text: &str) -> Result<CameraLink, String> {
    let (name, rest) = text.split_once(':').ok_or("no kind before a colon")?;
    let protocol = CameraProtocol::of_name(name);
    let mut protocol = protocol.ok_or_else(|| format!("unknown kind `{name}`"))?;
    let mut parts = rest.split(',');
    let (host, port) = parse_address(parts.next().unwrap_or_default(), protocol.default_port())?;
    let mut bodies: Vec<BodyRoute> = Vec::new();
    let mut seen = Vec::new();
    for part in parts {
        if let Some(body) = part.strip_prefix("body=") {
            bodies.push(parse_body(body)?);
            continue;
        }
        protocol.set(part)?;
        let key = part.split('=').next().unwrap_or_default();
        if seen.contains(&key) {
            return Err(format!("`{key}` twice"));
        }
        seen.push(key);
    }
    check_bodies(&bodies)?;
    Ok(CameraLink { protocol, host, port, bodies })
}

fn parse_address(text: &str, default_port: u16) -> Result<(String, u16), String> {
    let bad_port = |port: &str| format!("port `{port}` is not between 1 and 65535");
    let parse_port =
        |port: &str| port.parse().ok().filter(|port| *port > 0).ok_or_else(|| bad_port(port));
    // An IPv6 address is written in brackets, as in `[::1]:3883`.
    let (host, port) = match text.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((host, "")) => (host, default_port),
        Some((host, port)) => {
            (host, parse_port(port.strip_prefix(':').ok_or("text after the address")?)?)
        }
        None => match text.split_once(':') {
            Some((host, port)) => (host, parse_port(port)?),
            None => (text, default_port),
        },
    };
    if host.is_empty() {
        return Err("no host".to_owned());
    }
    Ok((host.to_owned(), port))
}

/// `NAME` or `NAME@INSTANCE`; an `@` in front of what is no instance belongs to the name.
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
            write!(f, ",body={name}")?;
            if let Some(instance) = instance {
                write!(f, "@{instance}")?;
            }
        }
        match self.protocol {
            CameraProtocol::Qtm { udp, minor } => {
                let transport = if udp { "" } else { ",transport=tcp" };
                let version =
                    if minor == 25 { String::new() } else { format!(",version=1.{minor}") };
                write!(f, "{transport}{version}")
            }
            CameraProtocol::Natnet { delivery: NatnetDelivery::Unicast } => write!(f, ",unicast"),
            CameraProtocol::Natnet { delivery: NatnetDelivery::Multicast(group) } => {
                write!(f, ",multicast={group}")
            }
            CameraProtocol::Vrpn
            | CameraProtocol::Natnet { delivery: NatnetDelivery::Announced } => Ok(()),
        }
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
    fn a_refusal_says_what_is_wrong_and_shows_the_forms() {
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
            ("vrpn:h,transport=udp", "`transport` is no option of vrpn"),
            ("natnet:h,multicast=10.0.0.1", "no multicast address"),
            ("vrpn:h,body=a@x,body=a@y", "body `a` twice"),
            ("vrpn:h,body=a@x,body=b@x", "two bodies for the instance x"),
            ("vrpn:h,body=a,body=b", "two bodies for the instance of the configuration"),
        ] {
            let message = text.parse::<CameraLink>().unwrap_err().to_string();
            assert!(message.contains(problem) && message.contains("natnet:HOST"), "{message}");
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
