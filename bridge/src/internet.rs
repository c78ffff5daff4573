//! Hosts of the internet protocols: their addresses, and errors of opening a port there.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, ToSocketAddrs};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr as UnixAddress, UnixDatagram};

use oqtal_wire::link::HostPort;

use crate::link::PortOpenError;

/// Addresses of `host`, at least one.
pub(crate) fn addresses(host: &HostPort) -> Result<Vec<SocketAddr>, PortOpenError> {
    let unknown = |reason: String| PortOpenError::UnknownHost { host: host.host.clone(), reason };
    let text = host.to_string();
    let found = text.to_socket_addrs().map_err(|error| unknown(error.to_string()))?;
    let found: Vec<SocketAddr> = found.collect();
    if found.is_empty() { Err(unknown("it has no address".to_owned())) } else { Ok(found) }
}

/// Claims the vehicle at `peer`, over the protocol `protocol`, for this process, until the value is dropped. Two programs that command one
/// vehicle would crash it, and binding a local port does not exclude others from a remote peer.
///
/// # Errors
/// Another process of this machine has claimed it, or the operating system refuses the socket.
pub(crate) fn claim(protocol: &str, peer: SocketAddr) -> Result<UnixDatagram, PortOpenError> {
    let name = format!("oqtal-vehicle-{protocol}-{peer}");
    let claimed = UnixAddress::from_abstract_name(name).and_then(|it| UnixDatagram::bind_addr(&it));
    claimed.map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => PortOpenError::Busy { path: peer.to_string() },
        _ => PortOpenError::System { port: peer.to_string(), reason: error.to_string() },
    })
}

/// The failure of `host` to become a port.
pub(crate) fn refused(host: &HostPort, error: &io::Error) -> PortOpenError {
    let address = host.to_string();
    match error.kind() {
        ErrorKind::AddrInUse => PortOpenError::AddressInUse { address },
        ErrorKind::AddrNotAvailable => PortOpenError::NotLocal { address },
        ErrorKind::ConnectionRefused | ErrorKind::TimedOut => PortOpenError::NoServer { address },
        ErrorKind::PermissionDenied => PortOpenError::Permission { path: address },
        _ => PortOpenError::System { port: address, reason: error.to_string() },
    }
}
