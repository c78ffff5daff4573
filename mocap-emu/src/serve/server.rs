//! What the network thread knows of every protocol.

use std::fmt;

use oqtal_bus::time::Time;
use oqtal_wire::motion::MotionFrame;
use rustix::event::PollFd;

/// Something that is served, and where.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Endpoint {
    /// Protocol, as on the command line.
    pub protocol: &'static str,
    /// What is there.
    pub what: &'static str,
    /// `tcp` or `udp`.
    pub transport: &'static str,
    /// Address and port.
    pub address: String,
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { protocol, what, transport, address } = self;
        write!(f, "{protocol:<7} {transport} {address:<21} {what}")
    }
}

/// The server of one protocol. No call blocks.
pub trait FrameServer: Send {
    /// What is served, and where.
    fn endpoints(&self) -> Vec<Endpoint>;

    /// Adds the sockets to wait for.
    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>);

    /// Accepts clients, reads and answers what they sent, sends what is queued, removes those that are gone.
    fn serve(&mut self, now: Time);

    /// Sends a frame to every client that wants it.
    fn broadcast(&mut self, frame: &MotionFrame<'_>);

    /// Number of clients \[-\].
    fn clients(&self) -> usize;
}
