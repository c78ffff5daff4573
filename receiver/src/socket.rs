//! Reads of sockets that do not block.

use std::fmt::Display;
use std::io::{self, ErrorKind, Read};
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};

use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};

/// Most datagrams of others that one call discards \[-\].
const MAX_FOREIGN: u32 = 64;

/// Reads a part of a stream; 0 if there is nothing now.
///
/// # Errors
/// The connection is lost or closed.
pub fn read_some(stream: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    match stream.read(buffer) {
        Ok(0) => Err(lost("the server closed the connection")),
        Err(error) if is_nothing(&error) => Ok(0),
        other => other,
    }
}

/// Receives one datagram of `server` and returns its length; 0 if none waits. Datagrams of other senders are discarded: any host in the
/// network can send them, and they do not contain poses.
///
/// # Errors
/// The socket is of no use any more.
pub fn receive_some(socket: &UdpSocket, server: IpAddr, buffer: &mut [u8]) -> io::Result<usize> {
    for _ in 0..MAX_FOREIGN {
        match socket.recv_from(buffer) {
            Ok((count, from)) if from.ip() == server && count > 0 => return Ok(count),
            Ok(_) => {}
            // Of a datagram before: its port was closed. The server may open it again.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
            Err(error) if is_nothing(&error) => return Ok(0),
            Err(error) => return Err(error),
        }
    }
    Ok(0)
}

/// Binds a port for datagrams to a multicast group that arrive at the interface of this address. Other programs of this
/// machine may receive them, too.
///
/// # Errors
/// The port is taken by a program that does not share it, or the group cannot be joined.
pub fn bind_group(group: Ipv4Addr, port: u16, interface: Ipv4Addr) -> io::Result<UdpSocket> {
    let flags = SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, flags, None)?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    bind(&socket, &SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, port))?;
    let socket = UdpSocket::from(socket);
    socket.join_multicast_v4(&group, &interface)?;
    Ok(socket)
}

/// The error of a connection that ended for this reason.
pub fn lost(reason: impl Display) -> io::Error {
    io::Error::new(ErrorKind::ConnectionAborted, reason.to_string())
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
