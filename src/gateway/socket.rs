//! The socket of the gateway, with the sender of each datagram as the kernel states it.

use std::fs::Permissions;
use std::io::{ErrorKind, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::Duration;

use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::origin::Origin;
use oqtal_bus::text::ShortText;
use oqtal_runtime::process::{Exit, Failure};
use rustix::io::Errno;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SocketAddrUnix, UCred, recvmsg, sockopt,
};

/// Time after which a wait for a datagram ends, so that a stop is noticed.
const TIMEOUT: Duration = Duration::from_millis(100);

/// Sender of a datagram.
#[derive(Debug)]
pub struct Sender {
    address: Option<PathBuf>,
    credentials: Option<UCred>,
}

impl Sender {
    /// `request` with the sender as its author.
    pub fn sign(&self, request: ControlRequestV1) -> ControlRequestV1 {
        let Some(UCred { pid, uid, .. }) = self.credentials else { return request };
        let pid = pid.as_raw_pid().unsigned_abs();
        let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
        let process = Origin::new(Origin::own().host(), pid).bits();
        let program = ShortText::new(&format!("gateway: {}", name.trim()));
        ControlRequestV1 { process, user: uid.as_raw(), program, ..request }
    }
}

/// The socket, which is removed with this object.
#[derive(Debug)]
pub struct GatewaySocket {
    socket: UnixDatagram,
    path: PathBuf,
}

impl GatewaySocket {
    /// Opens the socket at `path`; one left by a killed gateway is removed.
    ///
    /// # Errors
    /// Another gateway serves the path (exit code 75), or the operating system refuses (71).
    pub fn bind(path: &Path) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            Failure::new(Exit::System, format!("{}: {error}", path.display()))
        };
        let probe = UnixDatagram::unbound().map_err(failed)?;
        match probe.connect(path) {
            Ok(()) => {
                let message = format!("another gateway serves {}", path.display());
                return Err(Failure::new(Exit::Peer, message));
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                std::fs::remove_file(path).map_err(failed)?;
            }
            Err(_) => {}
        }
        let socket = UnixDatagram::bind(path).map_err(failed)?;
        std::fs::set_permissions(path, Permissions::from_mode(0o600)).map_err(failed)?;
        socket.set_read_timeout(Some(TIMEOUT)).map_err(failed)?;
        sockopt::set_socket_passcred(&socket, true).map_err(|error| failed(error.into()))?;
        Ok(Self { socket, path: path.to_owned() })
    }

    /// Waits for a datagram; returns its length and sender, `None` if none came for a while.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn receive(&self, datagram: &mut [u8]) -> Result<Option<(usize, Sender)>, Failure> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmCredentials(1))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let mut parts = [IoSliceMut::new(datagram)];
        let flags = RecvFlags::empty();
        let received = match recvmsg(&self.socket, &mut parts, &mut control, flags) {
            Ok(received) => received,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(None),
            Err(error) => {
                let message = format!("{}: {error}", self.path.display());
                return Err(Failure::new(Exit::System, message));
            }
        };
        let credentials = control.drain().find_map(|message| match message {
            RecvAncillaryMessage::ScmCredentials(credentials) => Some(credentials),
            _ => None,
        });
        let address = received.address.and_then(|any| SocketAddrUnix::try_from(any).ok());
        let path = address.as_ref().and_then(SocketAddrUnix::path);
        let address = path.and_then(|path| path.to_str().ok().map(PathBuf::from));
        Ok(Some((received.bytes, Sender { address, credentials })))
    }

    /// Sends `text` to `sender`; nothing if it has no address or does not receive.
    pub fn reply(&self, sender: &Sender, text: &str) {
        if let Some(address) = &sender.address {
            let _ = self.socket.set_nonblocking(true);
            let _ = self.socket.send_to(text.as_bytes(), address);
            let _ = self.socket.set_nonblocking(false);
        }
    }
}

impl Drop for GatewaySocket {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
