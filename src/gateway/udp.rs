//! The network socket of the gateway: datagrams with a code (HMAC-SHA256, RFC 2104) that only holders of the key can make.
//!
//! ```text
//! CODE program SESSION SEQUENCE\n
//! {"version": 1, ...}
//! ```
//!
//! `CODE` is of all that follows its space, in hexadecimal digits. A datagram that was received before is refused: each start of the
//! gateway has a random `SESSION`, in which each `SEQUENCE` counts once. Replies begin with `gateway` in place of `program`. A
//! datagram without a valid code, or without `program`, has no reply.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;

use hmac::{Hmac, KeyInit, Mac};
use oqtal_bus::time::Time;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::hex::{from_hex, to_hex};
use sha2::Sha256;

use super::session::Session;
use super::socket::{GatewaySocket, Incoming, Received, Sender, SenderAddress, wait_for_datagram};

/// Length of key and code \[bytes\].
const KEY_BYTES: usize = 32;

/// A secret key.
pub struct GatewayKey([u8; KEY_BYTES]);

impl GatewayKey {
    /// The key in `file`, as 64 hexadecimal digits.
    ///
    /// # Errors
    /// The file cannot be read (exit code 71), holds no key (65), or is not this user's alone (77).
    pub fn read(file: &Path) -> Result<Self, Failure> {
        let name = file.display();
        let make = format!("create one with: (umask 077; openssl rand -hex 32 > {name})");
        let text = files::read_secret(file).map_err(|error| match error.kind() {
            ErrorKind::PermissionDenied => {
                let reason = "a key must be hidden from other users";
                Failure::new(Exit::Permission, format!("{name}: {reason}: {error}"))
            }
            _ => Failure::new(Exit::System, format!("{name}: {error}; {make}")),
        })?;
        let key = from_hex(text.trim().as_bytes());
        key.map(Self).ok_or_else(|| {
            let message = format!("{name}: a key has 64 hexadecimal digits; {make}");
            Failure::new(Exit::Data, message)
        })
    }

    fn code(&self, text: &[u8]) -> Hmac<Sha256> {
        let code = Hmac::<Sha256>::new_from_slice(&self.0).expect("HMAC takes keys of any length");
        code.chain_update(text)
    }

    /// `text` with its code.
    fn signed(&self, text: &str) -> String {
        format!("{} {text}", to_hex(&self.code(text.as_bytes()).finalize().into_bytes()))
    }

    /// The part of `datagram` that its code confirms; `None` for a wrong code.
    fn confirmed<'a>(&self, datagram: &'a [u8]) -> Option<&'a [u8]> {
        let (code, text) = datagram.split_at_checked(2 * KEY_BYTES)?;
        let text = text.strip_prefix(b" ")?;
        // Takes the same time for every wrong code.
        self.code(text).verify_slice(&from_hex::<KEY_BYTES>(code)?).ok()?;
        Some(text)
    }
}

/// A socket on the network.
pub struct UdpGateway {
    socket: UdpSocket,
    key: GatewayKey,
    session: Session,
}

impl UdpGateway {
    /// Opens the socket at `address`.
    ///
    /// # Errors
    /// The operating system refuses (exit code 71).
    pub fn bind(address: SocketAddr, key: GatewayKey) -> Result<Self, Failure> {
        let failed =
            |error: std::io::Error| Failure::new(Exit::System, format!("{address}: {error}"));
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, key, session: Session::begin()? })
    }

    fn send(&self, address: SocketAddr, sequence: u64, text: &str) {
        let text = self.key.signed(&format!("{}\n{text}", self.session.reply_line(sequence)));
        let _ = self.socket.send_to(text.as_bytes(), address);
    }
}

impl GatewaySocket for UdpGateway {
    fn address(&self) -> String {
        self.socket.local_addr().map_or_else(|error| error.to_string(), |it| format!("udp:{it}"))
    }

    fn receive(&self, datagram: &mut [u8]) -> Result<Incoming, Failure> {
        let (length, address) = match self.socket.recv_from(datagram) {
            Ok(received) => received,
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock => return Ok(Incoming::Empty),
                ErrorKind::Interrupted => return Ok(Incoming::Ignored),
                _ => return Err(Failure::new(Exit::System, format!("UDP: {error}"))),
            },
        };
        let Some(text) = self.key.confirmed(&datagram[..length]) else {
            return Ok(Incoming::Ignored);
        };
        let line_end = text.iter().position(|byte| *byte == b'\n').unwrap_or(text.len());
        let line = String::from_utf8_lossy(&text[..line_end]);
        let clock = Time::now() + Time::wall_offset();
        Ok(match self.session.admit(&line, clock.nanos()) {
            Some(Ok(sequence)) => {
                let start = (length - text.len() + line_end + 1).min(length);
                let sender = Sender::network(address, sequence);
                Incoming::Datagram(Received { content: start..length, sender })
            }
            Some(Err((sequence, refusal))) => {
                self.send(address, sequence, &refusal.to_json());
                Incoming::Ignored
            }
            None => Incoming::Ignored,
        })
    }

    fn wait(&self) {
        wait_for_datagram(std::slice::from_ref(&self.socket));
    }

    fn reply(&self, sender: &Sender, text: &str) {
        if let Some(SenderAddress::Network(address, sequence)) = sender.address {
            self.send(address, sequence, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::code::OperatorCommand;
    use oqtal_bus::message::{ControlRequestV1, EventV1};

    use super::*;

    #[test]
    fn a_request_over_the_network_is_of_an_address_and_of_no_user() {
        let sender = Sender::network("192.0.2.7:8611".parse().unwrap(), 5);
        let request = sender.sign(ControlRequestV1::of(OperatorCommand::Land));
        let ControlRequestV1 { process, user, program, .. } = request;
        let event = EventV1 { process, user, program, ..EventV1::default() };
        assert_eq!(event.author(), "gateway: 192.0.2.7:8611 over UDP");
    }

    /// The second case of RFC 4231 has a key of another length; this code is from Python's `hmac`, with 32 bytes of 0x0b.
    #[test]
    fn codes_are_those_of_another_implementation() {
        let signed = GatewayKey([0x0b; KEY_BYTES]).signed("Hi There");
        let code = "198a607eb44bfbc69903a0f1cf2bbdc5ba0aa3f3d9ae3c1c7a3b1696a0b68cf7";
        assert_eq!(signed, format!("{code} Hi There"));
    }

    #[test]
    fn no_byte_of_a_datagram_can_be_changed() {
        let key = GatewayKey([7; KEY_BYTES]);
        let datagram = key.signed("session 5\n{}").into_bytes();
        assert_eq!(key.confirmed(&datagram), Some(&b"session 5\n{}"[..]));
        assert_eq!(GatewayKey([8; KEY_BYTES]).confirmed(&datagram), None);
        for index in 0..datagram.len() {
            let mut changed = datagram.clone();
            changed[index] ^= 1;
            assert_eq!(key.confirmed(&changed), None, "byte {index}");
            assert_ne!(key.confirmed(&datagram[..index]), Some(&b"session 5\n{}"[..]));
        }
    }
}
