//! Interface between the network thread and the servers of the protocols.

use std::net::SocketAddr;
use std::{fmt, io};

use oqtal_bus::time::Time;
use oqtal_wire::motion::MotionFrame;
use rustix::event::PollFd;

/// Address at which a protocol is served.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Endpoint {
    /// Protocol, as on the command line.
    pub protocol: &'static str,
    /// Service of the protocol at this address.
    #[serde(rename = "what")]
    pub service: &'static str,
    /// `tcp` or `udp`.
    pub transport: &'static str,
    /// Address and port.
    pub address: String,
}

impl Endpoint {
    /// Endpoint of a socket; its address is empty if the system does not report it.
    pub(super) fn of(
        (protocol, service): (&'static str, &'static str),
        transport: &'static str,
        address: io::Result<SocketAddr>,
    ) -> Self {
        let address = address.map_or(String::new(), |address| address.to_string());
        Self { protocol, service, transport, address }
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { protocol, service, transport, address } = self;
        write!(f, "{protocol:<7} {transport} {address:<21} {service}")
    }
}

/// The server of one protocol. No call blocks.
pub trait FrameServer: Send {
    /// Addresses at which the protocol is served.
    fn endpoints(&self) -> Vec<Endpoint>;

    /// Adds the sockets to wait for.
    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>);

    /// Accepts clients, reads and answers their requests, sends queued bytes, and removes clients that have left.
    fn serve(&mut self, now: Time);

    /// Sends a frame to every client that has subscribed to frames.
    fn broadcast(&mut self, frame: &MotionFrame<'_>);

    /// Number of clients \[-\].
    fn clients(&self) -> usize;
}
