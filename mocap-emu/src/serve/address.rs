//! Sockets at the addresses of a server, with errors that name address and remedy.

use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, UdpSocket};

use oqtal_runtime::process::{Exit, Failure};

/// Attempts to find a port that is free for TCP and UDP alike.
const PAIR_ATTEMPTS: usize = 16;

/// Opens a non-blocking listener.
pub fn listen(protocol: &str, address: SocketAddr) -> Result<TcpListener, Failure> {
    let opened = TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        Ok(listener)
    });
    opened.map_err(|error| refused(protocol, "TCP", address, &error))
}

/// Opens a non-blocking datagram socket.
pub fn datagrams(protocol: &str, address: SocketAddr) -> Result<UdpSocket, Failure> {
    let opened = UdpSocket::bind(address).and_then(|socket| {
        socket.set_nonblocking(true)?;
        Ok(socket)
    });
    opened.map_err(|error| refused(protocol, "UDP", address, &error))
}

/// Opens TCP and UDP at one port; port 0 selects a port that is free for both.
pub fn listen_both(
    protocol: &str,
    address: SocketAddr,
) -> Result<(TcpListener, UdpSocket), Failure> {
    let mut attempt = 0;
    loop {
        let listener = listen(protocol, address)?;
        let taken = SocketAddr::new(address.ip(), port_of(&listener));
        match datagrams(protocol, taken) {
            Ok(socket) => return Ok((listener, socket)),
            Err(_) if address.port() == 0 && attempt < PAIR_ATTEMPTS => attempt += 1,
            Err(failure) => return Err(failure),
        }
    }
}

/// Maximum number of datagrams read at a time from one socket \[-\].
const MAX_DATAGRAMS: usize = 64;

/// Passes the datagrams that wait at `socket`, with their senders, to `use_datagram`. Their number is limited, so that a flooding
/// sender does not delay the others.
pub fn for_each_datagram(
    socket: &UdpSocket,
    buffer: &mut [u8],
    mut use_datagram: impl FnMut(&[u8], SocketAddr),
) {
    for _ in 0..MAX_DATAGRAMS {
        let Ok((length, from)) = socket.recv_from(buffer) else { break };
        use_datagram(&buffer[..length], from);
    }
}

/// Port of a listener; chosen by the system if 0 was requested.
pub fn port_of(listener: &TcpListener) -> u16 {
    listener.local_addr().map_or(0, |address| address.port())
}

/// The port `distance` after `port`; port 0 (any free port) stays 0.
pub fn port_after(port: u16, distance: u16) -> u16 {
    if port == 0 { 0 } else { port.saturating_add(distance) }
}

/// Parses an address of this host.
pub fn local_address(text: &str) -> Result<IpAddr, Failure> {
    text.parse().map_err(|_| {
        let reason = format!("`{text}` is not an address to listen at; write 127.0.0.1 or 0.0.0.0");
        Failure::new(Exit::Config, reason)
    })
}

fn refused(protocol: &str, transport: &str, address: SocketAddr, error: &io::Error) -> Failure {
    let port = address.port();
    let (exit, remedy) = match error.kind() {
        io::ErrorKind::AddrInUse => {
            let remedy = format!(
                "is in use; stop the server there (`ss -lpn 'sport = :{port}'` names it) or serve {protocol}:OTHER-PORT"
            );
            (Exit::System, remedy)
        }
        io::ErrorKind::PermissionDenied => {
            (Exit::Permission, "is not permitted; choose a port from 1024 on".to_owned())
        }
        io::ErrorKind::AddrNotAvailable => {
            (Exit::System, "is not an address of this machine; `ip address` lists them".to_owned())
        }
        _ => (Exit::System, format!("cannot be opened: {error}")),
    };
    Failure::new(exit, format!("{protocol}: {transport} {address} {remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_not_permitted_is_named_with_its_remedy() {
        let error = io::Error::from(io::ErrorKind::PermissionDenied);
        let failure = refused("qtm", "TCP", SocketAddr::from(([127, 0, 0, 1], 80)), &error);
        assert_eq!(failure.exit, Exit::Permission);
        let expected = "qtm: TCP 127.0.0.1:80 is not permitted; choose a port from 1024 on";
        assert_eq!(failure.message, expected);
    }
}
