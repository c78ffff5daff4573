//! Ports of links: `serial:PATH`, `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT`.

use std::fmt;
use std::ops::RangeInclusive;

use super::radio::RadioSpec;
use super::text::{LinkText, option};

/// Allowed speeds of a serial port \[baud\].
pub(super) const BAUD: RangeInclusive<u32> = 1200..=3_000_000;

/// Serial port and its speed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialSpec {
    /// Path of the port.
    pub path: String,
    /// Speed \[baud\].
    pub baud: u32,
}

/// Host and port of the internet protocols.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostPort {
    /// Name or address of the host; an IPv6 address in brackets.
    pub host: String,
    /// Port, 1..65535 \[-\].
    pub port: u16,
}

/// Port to a vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortSpec {
    /// Serial port.
    Serial(SerialSpec),
    /// UDP, bound to an address of this machine; the other end sends first.
    UdpIn(HostPort),
    /// UDP to an address; this end sends first.
    UdpOut(HostPort),
    /// TCP, connected to a server.
    Tcp(HostPort),
    /// Crazyradio.
    Radio(RadioSpec),
}

impl SerialSpec {
    /// Parses a path, and takes the option `baud`.
    pub(super) fn parse(
        path: &str,
        link: &mut LinkText<'_>,
        default_baud: u32,
    ) -> Result<Self, String> {
        if path.is_empty() {
            return Err("no path of a serial port".to_owned());
        }
        let baud = link.take("baud")?.map_or(Ok(default_baud), parse_baud)?;
        Ok(Self { path: path.to_owned(), baud })
    }

    /// Text of the option `baud`.
    pub(super) fn option(&self, default_baud: u32) -> String {
        option("baud", Some(self.baud).filter(|baud| *baud != default_baud))
    }
}

fn parse_baud(value: &str) -> Result<u32, String> {
    let baud = value.parse().ok().filter(|baud| BAUD.contains(baud));
    baud.ok_or_else(|| format!("baud `{value}` is not between {} and {}", BAUD.start(), BAUD.end()))
}

impl HostPort {
    /// Parses `HOST:PORT`, or `HOST` alone where there is a default port.
    pub(super) fn parse(text: &str, default: Option<u16>) -> Result<Self, String> {
        let bracket = if text.starts_with('[') { text.find(']') } else { None };
        let end = bracket.map_or_else(|| text.find(':'), |bracket| Some(bracket + 1));
        let (host, rest) = text.split_at(end.unwrap_or(text.len()));
        let port = match (rest.strip_prefix(':'), default) {
            (Some(port), _) if bracket.is_none() && port.contains(':') => {
                return Err(format!("host `{text}`: write an IPv6 address in brackets"));
            }
            (Some(port), _) => parse_port(port)?,
            (None, _) if !rest.is_empty() => return Err("text after the address".to_owned()),
            (None, Some(default)) => default,
            (None, None) => return Err(format!("no port in `{text}`")),
        };
        match host {
            "" | "[]" => Err("no host before the port".to_owned()),
            host => Ok(Self { host: host.to_owned(), port }),
        }
    }
}

fn parse_port(text: &str) -> Result<u16, String> {
    let port = text.parse().ok().filter(|port: &u16| *port != 0);
    port.ok_or_else(|| format!("port `{text}` is not between 1 and 65535"))
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

impl PortSpec {
    /// Parses `KIND:…`; takes the option `baud` of a serial port.
    pub(super) fn parse(
        text: &str,
        link: &mut LinkText<'_>,
        default_baud: u32,
    ) -> Result<Self, String> {
        let (kind, rest) = text.split_once(':').ok_or_else(|| format!("no port in `{text}`"))?;
        match kind {
            "serial" => SerialSpec::parse(rest, link, default_baud).map(Self::Serial),
            "udpin" => HostPort::parse(rest, None).map(Self::UdpIn),
            "udpout" => HostPort::parse(rest, None).map(Self::UdpOut),
            "tcp" => HostPort::parse(rest, None).map(Self::Tcp),
            _ => Err(format!("unknown kind of port `{kind}`")),
        }
    }

    /// Text of the option `baud`; empty for ports without it.
    pub(super) fn option(&self, default_baud: u32) -> String {
        match self {
            Self::Serial(serial) => serial.option(default_baud),
            _ => String::new(),
        }
    }

    /// Speed of a serial port \[baud\]; `None` for other ports.
    pub fn baud(&self) -> Option<u32> {
        match self {
            Self::Serial(serial) => Some(serial.baud),
            Self::UdpIn(_) | Self::UdpOut(_) | Self::Tcp(_) | Self::Radio(_) => None,
        }
    }
}

impl fmt::Display for PortSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(serial) => write!(f, "serial:{}", serial.path),
            Self::UdpIn(address) => write!(f, "udpin:{address}"),
            Self::UdpOut(address) => write!(f, "udpout:{address}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::Radio(radio) => write!(f, "radio:{radio}"),
        }
    }
}
