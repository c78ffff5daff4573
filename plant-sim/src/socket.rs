//! UDP sockets of programs that run beside the plant: a firmware under test, its client, the simulator within an autopilot.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Longest wait for datagrams.
const LONGEST_WAIT: Span = Span::from_millis(20);

/// Socket that answers the last program that was accepted.
#[derive(Debug)]
pub struct PeerSocket {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
}

impl PeerSocket {
    /// Opens a socket at `address`; `user` says for whom, for the message.
    ///
    /// # Errors
    /// The address is in use (exit code 75), may not be used (77), or does not exist (71).
    pub fn open(address: SocketAddr, user: &str) -> Result<Self, Failure> {
        let opened = UdpSocket::bind(address).and_then(|socket| {
            socket.set_nonblocking(true)?;
            Ok(Self { socket, peer: None })
        });
        opened.map_err(|error| {
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

    /// Reads the next datagram into `buffer`; returns its length and sender, or `None` if there is none. What is longer than `buffer`
    /// is cut off.
    pub fn read(&self, buffer: &mut [u8]) -> Option<(usize, SocketAddr)> {
        self.socket.recv_from(buffer).ok()
    }

    /// Answers `sender` from now on; returns whether this is a change.
    pub fn accept(&mut self, sender: SocketAddr) -> bool {
        self.peer.replace(sender) != Some(sender)
    }

    /// Sends `bytes` to the program that was accepted last; without one, or if the kernel has no room, they are lost as on a radio.
    pub fn send(&self, bytes: &[u8]) {
        if let Some(peer) = self.peer {
            let _ = self.socket.send_to(bytes, peer);
        }
    }

    /// Whether a program was accepted.
    #[must_use]
    pub fn has_peer(&self) -> bool {
        self.peer.is_some()
    }
}

/// Sleeps until `until` or until a datagram arrives at one of the sockets, at most `LONGEST_WAIT`.
///
/// # Errors
/// The operating system refuses.
pub fn wait<const N: usize>(sockets: [&PeerSocket; N], until: Time) -> Result<(), Failure> {
    let left = until.since(Time::now()).clamp(Span::ZERO, LONGEST_WAIT).to_duration();
    let timeout = Timespec::try_from(left).unwrap_or_default();
    let mut fds = sockets.map(|peer| PollFd::new(&peer.socket, PollFlags::IN));
    match poll(&mut fds, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => {
            Err(Failure::new(Exit::System, format!("waiting for datagrams failed: {error}")))
        }
    }
}
