//! Sockets at both ends of a relay: datagrams, or a stream.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Addresses of a relay: its own, and those of bridge and vehicle unless they are learned from received datagrams. A relay of a
/// stream has `tcp:` before its near address, and connects to its far peer.
pub struct RelayPorts {
    pub near: &'static str,
    pub near_peer: Option<&'static str>,
    pub far: &'static str,
    pub far_peer: Option<&'static str>,
}

/// Ends of a relay.
pub enum RelayEnds {
    Datagrams { sockets: [UdpSocket; 2], peers: [Option<SocketAddr>; 2] },
    Stream { listener: TcpListener, vehicle: SocketAddr, ends: Option<[TcpStream; 2]> },
}

impl RelayEnds {
    pub fn open(ports: &RelayPorts) -> Self {
        let peer = |peer: Option<&str>| peer.map(|address| address.parse().unwrap());
        if let Some(near) = ports.near.strip_prefix("tcp:") {
            let listener = TcpListener::bind(near).unwrap();
            listener.set_nonblocking(true).unwrap();
            return Self::Stream { listener, vehicle: peer(ports.far_peer).unwrap(), ends: None };
        }
        let bind = |address: &str| {
            let socket = UdpSocket::bind(address).unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        };
        let peers = [peer(ports.near_peer), peer(ports.far_peer)];
        Self::Datagrams { sockets: [bind(ports.near), bind(ports.far)], peers }
    }

    /// Whether what is sent must arrive in its order.
    pub fn keep_order(&self) -> bool {
        matches!(self, Self::Stream { .. })
    }

    /// Waits until something arrives.
    pub fn wait(&mut self, most: &Timespec) {
        if let Self::Stream { listener, vehicle, ends } = self
            && let Ok((bridge, _)) = listener.accept()
        {
            // Without a vehicle the bridge's end is closed.
            *ends = TcpStream::connect(*vehicle).ok().map(|vehicle| [bridge, vehicle]);
            for stream in ends.iter().flatten() {
                stream.set_nonblocking(true).unwrap();
                stream.set_nodelay(true).unwrap();
            }
        }
        let mut fds: Vec<PollFd<'_>> = match self {
            Self::Datagrams { sockets, .. } => {
                sockets.iter().map(|socket| PollFd::new(socket, PollFlags::IN)).collect()
            }
            Self::Stream { listener, ends, .. } => {
                let streams = ends.iter().flatten();
                let streams = streams.map(|stream| PollFd::new(stream, PollFlags::IN));
                streams.chain([PollFd::new(listener, PollFlags::IN)]).collect()
            }
        };
        let _ = poll(&mut fds, Some(most));
    }

    /// Reads what has arrived at this end, and returns its length; `None` if nothing has.
    pub fn receive(&mut self, end: usize, buffer: &mut [u8]) -> Option<usize> {
        match self {
            Self::Datagrams { sockets, peers } => {
                let (length, sender) = sockets[end].recv_from(buffer).ok()?;
                peers[end] = Some(sender);
                Some(length)
            }
            Self::Stream { ends, .. } => match ends.as_mut()?[end].read(buffer) {
                Ok(length) if length > 0 => Some(length),
                Err(error) if error.kind() == ErrorKind::WouldBlock => None,
                // One end is closed: so is the other.
                _ => {
                    *ends = None;
                    None
                }
            },
        }
    }

    pub fn send(&mut self, end: usize, bytes: &[u8]) {
        match self {
            Self::Datagrams { sockets, peers } => {
                if let Some(peer) = peers[end] {
                    // A firmware that has ended does not receive.
                    let _ = sockets[end].send_to(bytes, peer);
                }
            }
            Self::Stream { ends: Some(ends), .. } => {
                let _ = ends[end].write_all(bytes);
            }
            Self::Stream { .. } => {}
        }
    }
}
