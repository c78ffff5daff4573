//! Requests of clients for a connection from the server.

use std::net::{IpAddr, SocketAddr};

/// Request of a client that listens on TCP: the server shall connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CallbackRequest {
    /// Address at which the client listens.
    pub address: SocketAddr,
}

impl CallbackRequest {
    /// Parses a datagram; `None` if it is not a request with a numeric address.
    pub fn parse(datagram: &[u8]) -> Option<Self> {
        let end = datagram.iter().position(|byte| *byte == 0).unwrap_or(datagram.len());
        let text = std::str::from_utf8(&datagram[..end]).ok()?;
        let (ip, port) = text.trim().split_once(' ')?;
        let (ip, port) = (ip.parse::<IpAddr>().ok()?, port.trim().parse().ok()?);
        (port > 0).then_some(Self { address: SocketAddr::new(ip, port) })
    }

    /// The datagram.
    pub fn to_datagram(self) -> Vec<u8> {
        format!("{} {}\0", self.address.ip(), self.address.port()).into_bytes()
    }
}
