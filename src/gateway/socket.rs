//! Sockets of the gateway; the Unix datagram socket, with the sender of each datagram as the kernel states it.

use std::fs::Permissions;
use std::io::{ErrorKind, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::ops::Range;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::time::Duration;

use oqtal_bus::message::{ControlRequestV1, NO_USER};
use oqtal_bus::origin::Origin;
use oqtal_bus::text::ShortText;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use rustix::io::Errno;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendFlags, SocketAddrUnix, UCred,
    recvmsg, sendto, sockopt,
};

/// Time after which a wait for a datagram ends, so that a stop is noticed.
pub const TIMEOUT: Duration = Duration::from_millis(100);

/// Source of datagrams.
pub trait GatewaySocket: Sync {
    /// The address for programs.
    fn address(&self) -> String;

    /// Waits for a datagram; `None` if none came for a while, or one that nobody may send.
    ///
    /// # Errors
    /// The operating system refuses.
    fn receive(&self, datagram: &mut [u8]) -> Result<Option<Received>, Failure>;

    /// Sends `text` to `sender`; nothing if it has no address or does not receive.
    fn reply(&self, sender: &Sender, text: &str);
}

/// A datagram received.
#[derive(Debug)]
pub struct Received {
    /// Range of the JSON object in the datagram.
    pub content: Range<usize>,
    /// The sender.
    pub sender: Sender,
}

/// Sender of a datagram.
#[derive(Debug)]
pub struct Sender {
    /// Where it receives replies.
    pub address: Option<SenderAddress>,
    /// Process on this machine; 0 for one of the network, or of a container whose processes cannot be seen.
    pub process: u32,
    /// Its user; [`NO_USER`] for one of the network.
    pub user: u32,
    /// Program; of process 0 its address, empty for none.
    pub program: String,
}

/// Address of a sender.
#[derive(Debug)]
pub enum SenderAddress {
    /// A socket of this machine.
    Path(PathBuf),
    /// One of the network, and the sequence number of the datagram.
    Network(SocketAddr, u64),
}

impl Sender {
    /// `request` with the sender as its author.
    pub fn sign(&self, request: ControlRequestV1) -> ControlRequestV1 {
        let process = Origin::new(Origin::own().host(), self.process).bits();
        let program = ShortText::new(&format!("gateway: {}", self.program));
        ControlRequestV1 { process, user: self.user, program, ..request }
    }

    /// The sender at `address` on the network, of a datagram with this sequence number.
    pub fn network(address: SocketAddr, sequence: u64) -> Self {
        let program = address.to_string();
        let address = Some(SenderAddress::Network(address, sequence));
        Self { address, process: 0, user: NO_USER, program }
    }

    /// Sequence number of the datagram; 0 on this machine, where datagrams keep their order.
    pub fn sequence(&self) -> u64 {
        match self.address {
            Some(SenderAddress::Network(_, sequence)) => sequence,
            _ => 0,
        }
    }

    /// The sender whose process and user the kernel states.
    fn local(address: Option<PathBuf>, credentials: Option<UCred>) -> Option<Self> {
        let UCred { pid, uid, .. } = credentials?;
        let process = pid.as_raw_pid().unsigned_abs();
        let program = match (process, &address) {
            (0, Some(path)) => path.display().to_string(),
            _ => std::fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default(),
        };
        let (address, program) = (address.map(SenderAddress::Path), program.trim().to_owned());
        Some(Self { address, process, user: uid.as_raw(), program })
    }
}

/// The socket, which is removed with this object.
#[derive(Debug)]
pub struct UnixGateway {
    socket: UnixDatagram,
    path: PathBuf,
    /// Device and inode of the socket's file: only this file is removed.
    file: Option<(u64, u64)>,
}

impl UnixGateway {
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
        Ok(Self { socket, path: path.to_owned(), file: files::identity(path) })
    }
}

impl GatewaySocket for UnixGateway {
    fn address(&self) -> String {
        self.path.display().to_string()
    }

    fn receive(&self, datagram: &mut [u8]) -> Result<Option<Received>, Failure> {
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
        let sender = Sender::local(address, credentials);
        Ok(sender.map(|sender| Received { content: 0..received.bytes, sender }))
    }

    fn reply(&self, sender: &Sender, text: &str) {
        let Some(SenderAddress::Path(path)) = &sender.address else { return };
        if let Ok(address) = SocketAddrUnix::new(path) {
            let _ = sendto(&self.socket, text.as_bytes(), SendFlags::DONTWAIT, &address);
        }
    }
}

impl Drop for UnixGateway {
    fn drop(&mut self) {
        files::remove_same(&self.path, self.file);
    }
}
