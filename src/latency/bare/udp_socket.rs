//! A UDP socket over the loopback interface: what a receiver of network frames has at best.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;

use oqtal_runtime::process::Failure;

use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender, WORDS};

const BYTES: usize = WORDS * 8;

/// One end; the file of the mechanism names the port of the receiving one.
#[derive(Debug)]
pub struct UdpEnd(UdpSocket);

impl UdpEnd {
    /// The sending end to the socket whose port the file at `path` names.
    ///
    /// # Errors
    /// There is no such file, or the operating system refuses.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let open = || {
            let port =
                std::fs::read_to_string(path)?.trim().parse().map_err(std::io::Error::other)?;
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
            socket.connect((Ipv4Addr::LOCALHOST, port))?;
            Ok(socket)
        };
        open().map(Self).map_err(|e: std::io::Error| system(Mechanism::UdpSocket, "connecting", &e))
    }

    /// A socket whose port is written to the file at `path`.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let create = || {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
            std::fs::write(path, socket.local_addr()?.port().to_string())?;
            Ok(socket)
        };
        create().map(Self).map_err(|e: std::io::Error| system(Mechanism::UdpSocket, "binding", &e))
    }
}

impl ParcelSender for UdpEnd {
    fn send(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        let mut bytes = [0; BYTES];
        for (bytes, word) in bytes.chunks_exact_mut(8).zip(parcel.words()) {
            bytes.copy_from_slice(&word.to_ne_bytes());
        }
        let sent = self.0.send(&bytes);
        sent.map(drop).map_err(|e| system(Mechanism::UdpSocket, "sending", &e))
    }
}

impl ParcelReceiver for UdpEnd {
    fn receive(&mut self) -> Result<Parcel, Failure> {
        let mut bytes = [0; BYTES];
        while let Err(error) = self.0.recv(&mut bytes) {
            if error.kind() != ErrorKind::Interrupted {
                return Err(system(Mechanism::UdpSocket, "receiving", &error));
            }
        }
        let mut words = [0; WORDS];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
            *word = u64::from_ne_bytes(*bytes);
        }
        Ok(Parcel::of_words(&words))
    }
}
