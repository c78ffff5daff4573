//! Datagram sockets, message and wake-up in one: a Unix socket, and UDP over the loopback interface.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use super::parcel::{Parcel, ParcelReceiver, ParcelSender, WORDS};

/// Sender to the Unix socket at `path`.
///
/// # Errors
/// No socket receives there.
pub fn unix_sender(path: &Path) -> io::Result<ParcelSender> {
    let socket = UnixDatagram::unbound()?;
    socket.connect(path)?;
    Ok(sender(move |bytes| socket.send(bytes)))
}

/// A Unix socket at `path`.
///
/// # Errors
/// The path is too long, or exists.
pub fn unix_receiver(path: &Path) -> io::Result<ParcelReceiver> {
    let socket = UnixDatagram::bind(path)?;
    Ok(receiver(move |bytes| socket.recv(bytes)))
}

/// Sender to the UDP socket whose port is in the file at `path`.
///
/// # Errors
/// The file does not exist, or the operating system refuses.
pub fn udp_sender(path: &Path) -> io::Result<ParcelSender> {
    let port: u16 = std::fs::read_to_string(path)?.trim().parse().map_err(io::Error::other)?;
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    socket.connect((Ipv4Addr::LOCALHOST, port))?;
    Ok(sender(move |bytes| socket.send(bytes)))
}

/// A UDP socket whose port is written to the file at `path`.
///
/// # Errors
/// The operating system refuses.
pub fn udp_receiver(path: &Path) -> io::Result<ParcelReceiver> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    std::fs::write(path, socket.local_addr()?.port().to_string())?;
    Ok(receiver(move |bytes| socket.recv(bytes)))
}

fn sender(send: impl Fn(&[u8]) -> io::Result<usize> + 'static) -> ParcelSender {
    Box::new(move |parcel| send(parcel.words().map(u64::to_ne_bytes).as_flattened()).map(drop))
}

fn receiver(receive: impl Fn(&mut [u8]) -> io::Result<usize> + 'static) -> ParcelReceiver {
    Box::new(move || {
        let mut words = [[0; 8]; WORDS];
        while let Err(error) = receive(words.as_flattened_mut()) {
            if error.kind() != ErrorKind::Interrupted {
                return Err(error);
            }
        }
        Ok(Parcel::of_words(&words.map(u64::from_ne_bytes)))
    })
}
