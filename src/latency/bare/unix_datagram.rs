//! A Unix datagram socket: message and wake-up in one.

use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use oqtal_runtime::process::Failure;

use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender, WORDS};

const BYTES: usize = WORDS * 8;

/// The sending end.
#[derive(Debug)]
pub struct DatagramSender(UnixDatagram);

impl DatagramSender {
    /// The sending end to the socket at `path`.
    ///
    /// # Errors
    /// Nobody listens there.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let socket = UnixDatagram::unbound().and_then(|socket| {
            socket.connect(path)?;
            Ok(socket)
        });
        Ok(Self(socket.map_err(|e| system(Mechanism::UnixDatagram, "connecting", &e))?))
    }
}

impl ParcelSender for DatagramSender {
    fn send(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        let mut bytes = [0; BYTES];
        for (bytes, word) in bytes.chunks_exact_mut(8).zip(parcel.words()) {
            bytes.copy_from_slice(&word.to_ne_bytes());
        }
        let sent = self.0.send(&bytes);
        sent.map(drop).map_err(|e| system(Mechanism::UnixDatagram, "sending", &e))
    }
}

/// The receiving end.
#[derive(Debug)]
pub struct DatagramReceiver(UnixDatagram);

impl DatagramReceiver {
    /// A socket at `path`.
    ///
    /// # Errors
    /// The path is too long, or taken.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let socket = UnixDatagram::bind(path);
        Ok(Self(socket.map_err(|e| system(Mechanism::UnixDatagram, "binding", &e))?))
    }
}

impl ParcelReceiver for DatagramReceiver {
    fn receive(&mut self) -> Result<Parcel, Failure> {
        let mut bytes = [0; BYTES];
        loop {
            match self.0.recv(&mut bytes) {
                Ok(_) => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(system(Mechanism::UnixDatagram, "receiving", &error)),
            }
        }
        let mut words = [0; WORDS];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
            *word = u64::from_ne_bytes(*bytes);
        }
        Ok(Parcel::of_words(&words))
    }
}
