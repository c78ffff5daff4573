//! TCP as a link, as the servers of simulated autopilots offer it: a stream of bytes.
//!
//! A connection that loses packets delays the data and sends it late. The kernel's buffer is therefore as small as possible, and
//! a connection whose bytes are not acknowledged for [`ACKNOWLEDGED_WITHIN`] is closed by the kernel and opened again. Over
//! radio, UDP is the better choice.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use oqtal_wire::link::HostPort;
use rustix::net::sockopt;

use crate::internet::{addresses, claim, refused};
use crate::link::{PortOpenError, PortOptions, VehicleLink, without_waiting};

/// Time within which a server must accept the connection.
const CONNECTED_WITHIN: Duration = Duration::from_millis(1500);
/// Time within which bytes must be acknowledged.
const ACKNOWLEDGED_WITHIN: Duration = Duration::from_millis(200);
/// Requested size of the send buffer \[bytes\]; the kernel takes more.
const SEND_BUFFER: usize = 1024;

/// Address of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TcpPortOptions {
    /// The server.
    pub server: HostPort,
    /// Whether other programs of this machine are excluded from it.
    pub is_exclusive: bool,
}

/// Open connection.
#[derive(Debug)]
pub struct TcpLink {
    stream: TcpStream,
    /// Excludes other programs from the vehicle.
    _claim: Option<UnixDatagram>,
}

impl PortOptions for TcpPortOptions {
    fn open(&self) -> Result<Box<dyn VehicleLink>, PortOpenError> {
        let (mut result, mut claimed) = (Err(ErrorKind::NotFound.into()), None);
        for address in addresses(&self.server)? {
            claimed = self.is_exclusive.then(|| claim("tcp", address)).transpose()?;
            result = TcpStream::connect_timeout(&address, CONNECTED_WITHIN);
            if result.is_ok() {
                break;
            }
        }
        let stream = result.and_then(prepared).map_err(|error| refused(&self.server, &error))?;
        Ok(Box::new(TcpLink { stream, _claim: claimed }))
    }
}

/// `stream` without waiting, merging or queueing.
fn prepared(stream: TcpStream) -> io::Result<TcpStream> {
    stream.set_nodelay(true)?;
    stream.set_nonblocking(true)?;
    sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER)?;
    let timeout_ms = u32::try_from(ACKNOWLEDGED_WITHIN.as_millis()).unwrap_or(u32::MAX);
    sockopt::set_tcp_user_timeout(&stream, timeout_ms)?;
    Ok(stream)
}

impl VehicleLink for TcpLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.stream.read(buffer) {
            Ok(0) => Err(ErrorKind::ConnectionAborted.into()),
            other => without_waiting(other),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        without_waiting(self.stream.write(bytes))
    }

    fn queued(&self) -> io::Result<usize> {
        Ok(0)
    }

    fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        Some(self.stream.as_fd())
    }

    /// Ends the connection: bytes that the kernel holds cannot be withdrawn in another way.
    fn discard(&mut self) -> io::Result<()> {
        Err(ErrorKind::TimedOut.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn bytes_go_both_ways_and_an_end_is_an_error() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = server.local_addr().unwrap().port();
        let options = TcpPortOptions {
            server: HostPort { host: "127.0.0.1".to_owned(), port },
            is_exclusive: true,
        };
        let mut link = options.open().unwrap();
        let (mut vehicle, _) = server.accept().unwrap();
        let mut buffer = [0; 16];
        assert_eq!(link.read(&mut buffer).unwrap(), 0, "nothing yet");
        assert_eq!(link.write(b"hello").unwrap(), 5);
        vehicle.read_exact(&mut buffer[..5]).unwrap();
        drop((vehicle, server));
        assert_eq!(link.read(&mut buffer).unwrap_err().kind(), ErrorKind::ConnectionAborted);
        assert!(matches!(options.open().unwrap_err(), PortOpenError::Busy { .. }));
        drop(link);
        let error = options.open().unwrap_err();
        assert!(matches!(error, PortOpenError::NoServer { .. }), "{error}");
    }

    #[test]
    fn a_server_that_takes_nothing_soon_fills_the_buffer_and_costs_the_connection() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = server.local_addr().unwrap().port();
        let options = TcpPortOptions {
            server: HostPort { host: "127.0.0.1".to_owned(), port },
            is_exclusive: true,
        };
        let mut link = options.open().unwrap();
        assert!(link.discard().is_err());
    }
}
