//! UDP as a link: one frame is one datagram.
//!
//! `udpin` is bound to an address of this machine and takes its peer from arriving datagrams: while the vehicle answers, the kernel
//! discards datagrams of other senders, so that they do not fill the queue. `udpout` sends to one address, and accepts datagrams only from
//! there.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;

use oqtal_wire::link::HostPort;

use crate::internet::{addresses, claim, refused};
use crate::link::{PortOpenError, PortOptions, VehicleLink, without_waiting};

/// Most datagrams of others that one read discards \[-\].
const MAX_FOREIGN: usize = 16;

/// Address of a UDP port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UdpPortOptions {
    /// Address of this machine to which vehicles send.
    In(HostPort),
    /// Address of the vehicle.
    Out {
        /// The address.
        host: HostPort,
        /// Whether other programs of this machine are excluded from it.
        is_exclusive: bool,
    },
}

/// Open UDP port.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    /// Peer from which datagrams arrived; `None` for a connected socket, whose peer the operating system stores.
    learned: Option<LearnedPeer>,
    /// Excludes other programs from the peer of a connected socket.
    _claim: Option<UnixDatagram>,
}

/// Peer of a port to which vehicles send.
#[derive(Debug, Default)]
struct LearnedPeer {
    address: Option<SocketAddr>,
    is_kept: bool,
}

impl PortOptions for UdpPortOptions {
    fn open(&self) -> Result<Box<dyn VehicleLink>, PortOpenError> {
        let (Self::In(host) | Self::Out { host, .. }) = self;
        let refused = |error: io::Error| refused(host, &error);
        let addresses = addresses(host)?;
        let link = match self {
            Self::In(_) => {
                let socket = UdpSocket::bind(addresses.as_slice()).map_err(refused)?;
                UdpLink { socket, learned: Some(LearnedPeer::default()), _claim: None }
            }
            Self::Out { is_exclusive, .. } => {
                let peer = addresses[0];
                let claim = is_exclusive.then(|| claim("udp", peer)).transpose()?;
                let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any).map_err(refused)?;
                socket.connect(peer).map_err(refused)?;
                UdpLink { socket, learned: None, _claim: claim }
            }
        };
        link.socket.set_nonblocking(true).map_err(refused)?;
        Ok(Box::new(link))
    }
}

impl VehicleLink for UdpLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(learned) = &mut self.learned else {
            return absent_is_silent(self.socket.recv(buffer));
        };
        for _ in 0..MAX_FOREIGN {
            let (count, source) = match self.socket.recv_from(buffer) {
                Ok(received) => received,
                Err(error) => return absent_is_silent(Err(error)),
            };
            if !learned.is_kept || learned.address.is_none() {
                learned.address = Some(source);
            }
            if learned.address == Some(source) {
                return Ok(count);
            }
        }
        Ok(0)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent = match &self.learned {
            None => self.socket.send(bytes),
            Some(LearnedPeer { address: Some(peer), .. }) => self.socket.send_to(bytes, peer),
            // No peer is known yet: the frame is lost, as on a network.
            Some(LearnedPeer { address: None, .. }) => return Ok(bytes.len()),
        };
        match sent {
            // The other end or the route to it is missing: a datagram is lost.
            Err(error) if is_absence(error.kind()) => Ok(bytes.len()),
            other => without_waiting(other),
        }
    }

    fn queued(&self) -> io::Result<usize> {
        Ok(0)
    }

    fn discard(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// A peer that is kept is that of the descriptor, too.
    fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        Some(self.socket.as_fd())
    }

    fn keep_peer(&mut self, is_kept: bool) {
        let Some(learned) = &mut self.learned else { return };
        if std::mem::replace(&mut learned.is_kept, is_kept) == is_kept {
            return;
        }
        // If the kernel refuses, `read` does the filtering.
        let _ = match learned.address.filter(|_| is_kept) {
            Some(peer) => self.socket.connect(peer),
            None => rustix::net::connect_unspec(&self.socket).map_err(io::Error::from),
        };
    }
}

/// `result`, with 0 bytes in place of an error for an absent peer.
fn absent_is_silent(result: io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(error) if is_absence(error.kind()) => Ok(0),
        other => without_waiting(other),
    }
}

fn is_absence(kind: ErrorKind) -> bool {
    use ErrorKind::{ConnectionRefused, ConnectionReset, HostUnreachable, NetworkUnreachable};
    matches!(
        kind,
        ConnectionRefused
            | ConnectionReset
            | HostUnreachable
            | NetworkUnreachable
            | ErrorKind::NetworkDown
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here(port: u16) -> HostPort {
        HostPort { host: "127.0.0.1".to_owned(), port }
    }

    /// An open port to which `vehicles` vehicles send, and those.
    fn listening(vehicles: usize) -> (Box<dyn VehicleLink>, Vec<UdpSocket>) {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let link = UdpPortOptions::In(here(port)).open().unwrap();
        let vehicle = || {
            let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
            vehicle.connect(("127.0.0.1", port)).unwrap();
            vehicle.set_nonblocking(true).unwrap();
            vehicle
        };
        (link, std::iter::repeat_with(vehicle).take(vehicles).collect())
    }

    #[test]
    fn the_peer_is_the_last_sender_until_the_vehicle_answers() {
        let (mut link, vehicles) = listening(2);
        let mut buffer = [0; 16];
        assert_eq!(link.write(b"frame").unwrap(), 5);
        for (vehicle, name) in vehicles.iter().zip([b"a", b"b"]) {
            vehicle.send(name).unwrap();
            assert_eq!((link.read(&mut buffer).unwrap(), &buffer[..1]), (1, &name[..]));
            link.write(b"hello").unwrap();
            assert_eq!(vehicle.recv(&mut buffer).unwrap(), 5);
        }
        link.keep_peer(true);
        vehicles[0].send(b"a").unwrap();
        assert_eq!(link.read(&mut buffer).unwrap(), 0, "of another");
        vehicles[1].send(b"b").unwrap();
        assert_eq!(link.read(&mut buffer).unwrap(), 1);
        link.keep_peer(false);
        // The first socket gets the error of the refused other one.
        let _ = vehicles[0].send(b"a");
        let _ = vehicles[0].send(b"a");
        assert_eq!(link.read(&mut buffer).unwrap(), 1, "the vehicle was restarted");
    }

    #[test]
    fn a_flood_of_others_leaves_room_for_the_vehicle_that_answers() {
        let (mut link, vehicles) = listening(2);
        let [vehicle, other] = &vehicles[..] else { panic!("two vehicles") };
        let mut buffer = [0; 16];
        vehicle.send(b"a").unwrap();
        assert_eq!(link.read(&mut buffer).unwrap(), 1);
        link.keep_peer(true);
        for _ in 0..5000 {
            // Refused from the first one on, which the next call tells.
            let _ = other.send(b"other");
        }
        vehicle.send(b"a").unwrap();
        assert_eq!((link.read(&mut buffer).unwrap(), buffer[0]), (1, b'a'));
        link.write(b"hello").unwrap();
        assert_eq!(vehicle.recv(&mut buffer).unwrap(), 5);
        link.keep_peer(false);
        let _ = other.send(b"s");
        let _ = other.send(b"s");
        assert_eq!((link.read(&mut buffer).unwrap(), buffer[0]), (1, b's'), "anybody again");
    }

    #[test]
    fn a_vehicle_that_is_missing_at_first_is_not_an_error() {
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut link = UdpPortOptions::Out { host: here(free), is_exclusive: true }.open().unwrap();
        let mut buffer = [0; 16];
        for _ in 0..3 {
            assert_eq!(link.write(b"hello").unwrap(), 5);
            assert_eq!(link.read(&mut buffer).unwrap(), 0);
        }
        let vehicle = UdpSocket::bind(("127.0.0.1", free)).unwrap();
        link.write(b"hello").unwrap();
        assert_eq!(vehicle.recv(&mut buffer).unwrap(), 5);
    }

    #[test]
    fn errors_distinguish_an_address_in_use_from_one_of_another_machine() {
        let holder = UdpSocket::bind("127.0.0.1:0").unwrap();
        let used = here(holder.local_addr().unwrap().port());
        let error = UdpPortOptions::In(used).open().unwrap_err();
        assert!(matches!(error, PortOpenError::AddressInUse { .. }), "{error}");
        let elsewhere = HostPort { host: "192.0.2.1".to_owned(), port: 14_550 };
        let error = UdpPortOptions::In(elsewhere).open().unwrap_err();
        assert!(matches!(error, PortOpenError::NotLocal { .. }), "{error}");
        let nowhere = HostPort { host: "no.such.host.invalid".to_owned(), port: 1 };
        let error = UdpPortOptions::Out { host: nowhere, is_exclusive: true }.open().unwrap_err();
        assert!(matches!(error, PortOpenError::UnknownHost { .. }), "{error}");
    }
}
