//! Protocols to serve, as text: `qtm[:PORT],vrpn[:PORT],natnet[:PORT]`.

use std::net::IpAddr;
use std::str::FromStr;

use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::natnet::{COMMAND_PORT, NatNetServerOptions};
use oqtal_wire::qtm::LITTLE_ENDIAN_PORT;
use oqtal_wire::vrpn::VRPN_PORT;

use super::address::port_after;
use super::model::BodyModels;
use super::natnet_server::NatNetSocket;
use super::qtm_server::QtmServer;
use super::server::FrameServer;
use super::vrpn_server::VrpnServer;

/// Protocols to serve, each with its port; 0 is any free port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServeSpec {
    qtm: Option<u16>,
    vrpn: Option<u16>,
    natnet: Option<u16>,
}

impl ServeSpec {
    /// Whether no protocol is served.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Protocol, transport and number of every port that is opened.
    fn ports(&self) -> Vec<(&'static str, &'static str, u16)> {
        let mut ports = Vec::new();
        let mut add = |protocol, first: Option<u16>, used: &[(&'static str, u16)]| {
            let first = first.filter(|port| *port != 0).into_iter();
            ports.extend(first.flat_map(|port| {
                used.iter().map(move |(transport, distance)| {
                    (protocol, *transport, port_after(port, *distance))
                })
            }));
        };
        add("qtm", self.qtm, &[("TCP", 0), ("TCP", 1), ("UDP", 3)]);
        add("vrpn", self.vrpn, &[("TCP", 0), ("UDP", 0)]);
        add("natnet", self.natnet, &[("UDP", 0)]);
        ports
    }

    /// Refuses two protocols that need the same port.
    fn check_ports(&self) -> Result<(), InvalidServeSpec> {
        let ports = self.ports();
        let clash = ports.iter().enumerate().find_map(|(number, (protocol, transport, port))| {
            let (other, ..) = ports[number + 1..]
                .iter()
                .find(|(_, other, later)| (other, later) == (transport, port))?;
            Some(InvalidServeSpec::SamePort(protocol, other, transport, *port))
        });
        clash.map_or(Ok(()), Err)
    }

    /// Opens the servers.
    pub(super) fn open(
        &self,
        ip: IpAddr,
        natnet: NatNetServerOptions,
        models: &BodyModels,
    ) -> Result<Vec<Box<dyn FrameServer>>, Failure> {
        let mut servers: Vec<Box<dyn FrameServer>> = Vec::new();
        if let Some(port) = self.qtm {
            servers.push(Box::new(QtmServer::open(ip, port, models)?));
        }
        if let Some(port) = self.vrpn {
            servers.push(Box::new(VrpnServer::open(ip, port, models)?));
        }
        if let Some(port) = self.natnet {
            servers.push(Box::new(NatNetSocket::open(ip, port, natnet)?));
        }
        Ok(servers)
    }
}

/// Error in the text of [`ServeSpec`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InvalidServeSpec {
    /// Unknown protocol.
    #[error(
        "unknown protocol `{0}`; write qtm[:PORT], vrpn[:PORT] and natnet[:PORT], separated by commas"
    )]
    Protocol(String),
    /// Port that is not a number up to 65535.
    #[error("`{0}` is not a port of {1}; write a number up to 65535, or 0 for any free port")]
    Port(String, String),
    /// Two protocols that need the same port.
    #[error("{0} and {1} both need {2} port {3}; give one of them another port")]
    SamePort(&'static str, &'static str, &'static str, u16),
    /// Protocol that is named twice.
    #[error("{0} is named twice")]
    Twice(String),
}

impl From<InvalidServeSpec> for Failure {
    fn from(error: InvalidServeSpec) -> Self {
        Self::new(Exit::Config, format!("mocap.serve.protocols: {error}"))
    }
}

impl FromStr for ServeSpec {
    type Err = InvalidServeSpec;

    fn from_str(text: &str) -> Result<Self, InvalidServeSpec> {
        let mut spec = Self::default();
        for item in text.split(',').map(str::trim).filter(|item| !item.is_empty()) {
            let (name, port) = match item.split_once(':') {
                Some((name, port)) => (name, Some(port)),
                None => (item, None),
            };
            let (place, default) = match name {
                "qtm" => (&mut spec.qtm, LITTLE_ENDIAN_PORT),
                "vrpn" => (&mut spec.vrpn, VRPN_PORT),
                "natnet" => (&mut spec.natnet, COMMAND_PORT),
                _ => return Err(InvalidServeSpec::Protocol(name.to_owned())),
            };
            let wrong = |port: &str| InvalidServeSpec::Port(port.to_owned(), name.to_owned());
            let port = port.map_or(Ok(default), |port| port.parse().map_err(|_| wrong(port)))?;
            if place.replace(port).is_some() {
                return Err(InvalidServeSpec::Twice(name.to_owned()));
            }
        }
        spec.check_ports()?;
        Ok(spec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocols_are_named_with_and_without_a_port() {
        let spec: ServeSpec = "qtm,vrpn:0, natnet:4000".parse().unwrap();
        assert_eq!(spec, ServeSpec { qtm: Some(22223), vrpn: Some(0), natnet: Some(4000) });
        assert!("".parse::<ServeSpec>().unwrap().is_empty());
        let clash = "qtm:3882,vrpn".parse::<ServeSpec>().unwrap_err().to_string();
        assert!(clash.starts_with("qtm and vrpn both need TCP port 3883"), "{clash}");
        assert!("natnet:0,vrpn:0,qtm:3879".parse::<ServeSpec>().is_ok());
        for wrong in ["vicon", "qtm:", "qtm:65536", "qtm,qtm:1", "qtm:4000,natnet:4003"] {
            assert!(wrong.parse::<ServeSpec>().is_err(), "{wrong}");
        }
    }
}
