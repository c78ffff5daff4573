//! Ports of programs beside the plant: host of an emulated vehicle, firmware under test, its client, simulator inside an
//! autopilot.

use std::fmt::Display;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Longest wait for datagrams or bytes.
const LONGEST_WAIT: Span = Span::from_millis(20);
/// Maximum number of datagrams read in one turn from each socket \[-\].
pub const MOST_READ: usize = 64;

/// Port to the host of an emulated vehicle.
pub trait VehiclePort {
    /// Waits until bytes arrive (if `listen` is set) or until this instant. May return early.
    ///
    /// # Errors
    /// The port failed.
    fn wait(&self, until: Time, listen: bool) -> Result<(), Failure>;

    /// Reads the bytes that have arrived, or one packet, into `buffer`; returns their number, 0 for none.
    ///
    /// # Errors
    /// The port failed.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure>;

    /// Writes bytes, or one packet; bytes that the port does not accept are lost.
    ///
    /// # Errors
    /// The port failed.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure>;

    /// Maintains the port; to be called in every turn.
    fn maintain(&mut self) {}
}

/// Socket that sends to one address, or to the last program that was accepted.
#[derive(Debug)]
pub struct PeerSocket {
    socket: UdpSocket,
    /// The last program that was accepted.
    peer: Option<SocketAddr>,
    is_connected: bool,
}

impl PeerSocket {
    /// Opens a socket at `address` of this machine; error messages name `user`.
    ///
    /// # Errors
    /// The address is in use (exit code 75), may not be used (77), or does not exist (71).
    pub fn open(address: &impl Display, user: &str) -> Result<Self, Failure> {
        Self::with_socket(UdpSocket::bind(address.to_string()), false).map_err(|error| {
            let (exit, remedy) = match error.kind() {
                ErrorKind::AddrInUse => {
                    (Exit::Peer, "stop the program that uses it, or name another port")
                }
                ErrorKind::PermissionDenied => (Exit::Permission, "name a port above 1023"),
                _ => (Exit::System, "name an address of this machine, such as 127.0.0.1"),
            };
            Failure::new(exit, format!("udp:{address}, for {user}: {error}; {remedy}"))
        })
    }

    /// Opens a socket that exchanges datagrams with `address` only; this side sends first.
    ///
    /// # Errors
    /// The host does not exist, or the operating system refuses.
    pub fn connect(address: &impl Display, user: &str) -> Result<Self, Failure> {
        let socket = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
            socket.connect(address.to_string())?;
            Ok(socket)
        });
        Self::with_socket(socket, true).map_err(|error| {
            Failure::new(Exit::System, format!("udp:{address}, for {user}: {error}"))
        })
    }

    fn with_socket(socket: io::Result<UdpSocket>, is_connected: bool) -> io::Result<Self> {
        let socket = socket?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, peer: None, is_connected })
    }

    /// Reads the next datagram into `buffer`; returns its length and sender, or `None` if there is none. A datagram longer than
    /// `buffer` is cut off.
    ///
    /// # Errors
    /// The socket failed.
    pub fn receive(&self, buffer: &mut [u8]) -> Result<Option<(usize, SocketAddr)>, Failure> {
        match self.socket.recv_from(buffer) {
            Ok(received) => Ok(Some(received)),
            Err(error) if is_absence(error.kind()) => Ok(None),
            Err(error) => Err(failed("reading", &error)),
        }
    }

    /// Sends to `sender` from now on; returns whether the peer has changed.
    pub fn accept(&mut self, sender: SocketAddr) -> bool {
        self.peer.replace(sender) != Some(sender)
    }

    /// Sends `bytes`. Without an accepted program, or if the send buffer is full, they are lost as on a radio.
    ///
    /// # Errors
    /// The socket failed.
    pub fn send(&self, bytes: &[u8]) -> Result<(), Failure> {
        let sent = match self.peer {
            _ if self.is_connected => self.socket.send(bytes),
            Some(peer) => self.socket.send_to(bytes, peer),
            None => return Ok(()),
        };
        match sent {
            Err(error) if !is_absence(error.kind()) => Err(failed("writing", &error)),
            _ => Ok(()),
        }
    }

    /// Whether a program was accepted.
    pub fn has_peer(&self) -> bool {
        self.peer.is_some()
    }
}

impl VehiclePort for PeerSocket {
    fn wait(&self, until: Time, listen: bool) -> Result<(), Failure> {
        let fds: &[&Self] = if listen { &[self] } else { &[] };
        wait(fds, until)
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure> {
        let received = self.receive(buffer)?;
        Ok(received.map_or(0, |(length, sender)| {
            self.accept(sender);
            length
        }))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.send(bytes)
    }
}

/// Sleeps until `until` or until a datagram arrives at one of the sockets, at most `LONGEST_WAIT`.
///
/// # Errors
/// The operating system refuses.
pub fn wait(sockets: &[&PeerSocket], until: Time) -> Result<(), Failure> {
    let fds = sockets.iter().map(|peer| PollFd::new(&peer.socket, PollFlags::IN));
    wait_until(until, &mut fds.collect::<Vec<_>>())
}

/// Sleeps until `until` or until one of `fds` is ready, at most `LONGEST_WAIT`.
///
/// # Errors
/// The operating system refuses.
pub fn wait_until(until: Time, fds: &mut [PollFd<'_>]) -> Result<(), Failure> {
    let left = until.since(Time::now()).clamp(Span::ZERO, LONGEST_WAIT).to_duration();
    let timeout = Timespec::try_from(left).unwrap_or_default();
    match poll(fds, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(failed("waiting", &error)),
    }
}

/// Whether an error of this kind means that no program receives, that nothing has arrived, or that the buffer is full.
fn is_absence(kind: ErrorKind) -> bool {
    use ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, WouldBlock};
    matches!(kind, ConnectionRefused | ConnectionReset | Interrupted | WouldBlock)
}

fn failed(action: &str, error: &impl Display) -> Failure {
    Failure::new(Exit::System, format!("{action} at the vehicle's port failed: {error}"))
}
