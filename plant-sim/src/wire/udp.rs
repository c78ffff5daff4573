//! UDP port of an emulated vehicle: it sends to one address, or to whoever sent last.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::HostPort;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::end::VehiclePort;

/// Longest wait for a datagram.
const LONGEST_WAIT: Span = Span::from_millis(20);

/// UDP port.
#[derive(Debug)]
pub struct UdpPort {
    socket: UdpSocket,
    /// `None` until a host has sent something.
    peer: Option<SocketAddr>,
    /// Whether the peer is whoever sent last.
    learns: bool,
}

impl UdpPort {
    /// Port to the host at `address`, to which the vehicle sends first.
    ///
    /// # Errors
    /// There is no such host, or the operating system refuses.
    pub fn to(address: &HostPort) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| refused(address, &error);
        let socket = UdpSocket::bind("0.0.0.0:0").map_err(failed)?;
        socket.connect(address.to_string()).map_err(failed)?;
        Self::open(socket, address, false)
    }

    /// Port at `address` of this machine, for the host that sends first.
    ///
    /// # Errors
    /// The address is in use or of another machine.
    pub fn at(address: &HostPort) -> Result<Self, Failure> {
        let socket = UdpSocket::bind(address.to_string()).map_err(|e| refused(address, &e))?;
        Self::open(socket, address, true)
    }

    fn open(socket: UdpSocket, address: &HostPort, learns: bool) -> Result<Self, Failure> {
        socket.set_nonblocking(true).map_err(|error| refused(address, &error))?;
        Ok(Self { socket, peer: None, learns })
    }
}

fn refused(address: &HostPort, error: &std::io::Error) -> Failure {
    let (exit, remedy) = match error.kind() {
        ErrorKind::AddrInUse => {
            (Exit::Peer, "; stop the process that uses it, or name another port")
        }
        ErrorKind::AddrNotAvailable => {
            (Exit::System, "; name an address of this machine, as 127.0.0.1")
        }
        _ => (Exit::System, ""),
    };
    let message = format!("the port {address} of the emulated vehicle failed: {error}{remedy}");
    Failure::new(exit, message)
}

/// Whether `kind` says that nobody is there, or that nothing has arrived.
fn is_absence(kind: ErrorKind) -> bool {
    use ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, WouldBlock};
    matches!(kind, ConnectionRefused | ConnectionReset | Interrupted | WouldBlock)
}

impl VehiclePort for UdpPort {
    fn wait(&self, until: Time, listen: bool) -> Result<(), Failure> {
        let left = until.since(Time::now()).clamp(Span::ZERO, LONGEST_WAIT).to_duration();
        let timeout = Timespec::try_from(left).unwrap_or_default();
        let flags = if listen { PollFlags::IN } else { PollFlags::empty() };
        match poll(&mut [PollFd::new(&self.socket, flags)], Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(error) => Err(Failure::new(Exit::System, format!("waiting failed: {error}"))),
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure> {
        match self.socket.recv_from(buffer) {
            Ok((count, source)) => {
                self.peer = Some(source);
                Ok(count)
            }
            Err(error) if is_absence(error.kind()) => Ok(0),
            Err(error) => Err(Failure::new(Exit::System, format!("reading failed: {error}"))),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let sent = match (self.learns, self.peer) {
            (false, _) => self.socket.send(bytes),
            (true, Some(peer)) => self.socket.send_to(bytes, peer),
            (true, None) => return Ok(()),
        };
        match sent {
            Err(error) if !is_absence(error.kind()) => {
                Err(Failure::new(Exit::System, format!("writing failed: {error}")))
            }
            _ => Ok(()),
        }
    }
}
