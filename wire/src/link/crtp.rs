//! Links of CRTP: `crtp:radio:CHANNEL/RATE/ADDRESS` or `crtp:udp:HOST:PORT`.

use std::fmt;

use super::port::{HostPort, PortSpec};
use super::radio::RadioSpec;
use super::text::LinkText;

/// Path to a Crazyflie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CrtpLink {
    /// Through a Crazyradio.
    Radio(RadioSpec),
    /// One packet per datagram, to this address: firmware in the loop, an emulated vehicle, or a radio that another program shares.
    Udp(HostPort),
}

impl CrtpLink {
    /// Text form, for messages.
    pub const FORM: &str = "crtp:radio:CHANNEL/RATE/ADDRESS | crtp:udp:HOST:PORT";

    /// Parses the port; there are no options.
    pub(super) fn parse(port: &str, _: &mut LinkText<'_>) -> Result<Self, String> {
        let (kind, rest) = port.split_once(':').ok_or_else(|| format!("no port in `{port}`"))?;
        match kind {
            "radio" => rest.parse().map(Self::Radio),
            "udp" => HostPort::parse(rest, None).map(Self::Udp),
            _ => Err(format!("unknown kind of port `{kind}`")),
        }
    }

    /// The port on the bridge's side.
    pub fn port(&self) -> PortSpec {
        match self {
            Self::Radio(radio) => PortSpec::Radio(*radio),
            Self::Udp(vehicle) => PortSpec::UdpOut(vehicle.clone()),
        }
    }
}

impl fmt::Display for CrtpLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Radio(radio) => write!(f, "radio:{radio}"),
            Self::Udp(vehicle) => write!(f, "udp:{vehicle}"),
        }
    }
}
