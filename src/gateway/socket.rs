//! Sockets of the gateway; the Unix datagram socket, with the sender of each datagram as the kernel states it.

use std::fs::Permissions;
use std::io::{self, ErrorKind, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::ops::Range;
use std::os::fd::AsFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use oqtal_bus::message::{ControlRequestV1, NO_USER};
use oqtal_bus::origin::Origin;
use oqtal_bus::text::ShortText;
use oqtal_bus::time::Time;
use oqtal_runtime::kept_file::KeptFile;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendFlags, SocketAddrUnix, UCred,
    recvmsg, sendto, sockopt,
};

/// Time after which a wait for a datagram ends, so that a stop, and a time in which the gateway was held up, are noticed.
const TIMEOUT_NS: i64 = 20_000_000;
/// Maximum number of sockets that receive: the present one, and those before it whose file was removed \[-\].
const MOST_SOCKETS: usize = 4;

/// Source of datagrams.
pub trait GatewaySocket: Sync {
    /// The address for programs.
    fn address(&self) -> String;

    /// Takes the next datagram that waits.
    ///
    /// # Errors
    /// The operating system refuses.
    fn receive(&self, datagram: &mut [u8]) -> Result<Incoming, Failure>;

    /// Waits until a datagram arrives, with a time-out.
    fn wait(&self);

    /// Sends `text` to `sender`; nothing if it has no address or does not receive.
    fn reply(&self, sender: &Sender, text: &str);
}

/// Result of a reception.
#[derive(Debug)]
pub enum Incoming {
    /// No datagram waits.
    Empty,
    /// One that nobody may send.
    Ignored,
    /// A datagram.
    Datagram(Received),
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
    /// Address at which the sender receives replies.
    pub address: Option<SenderAddress>,
    /// Process id on this machine; 0 for a sender on the network, or in a container whose processes cannot be seen.
    pub process: u32,
    /// User id of the process; [`NO_USER`] for a sender on the network.
    pub user: u32,
    /// Name of the program; for process 0 its address, empty without one.
    pub program: String,
}

/// Address of a sender.
#[derive(Debug)]
pub enum SenderAddress {
    /// A socket of this machine, and the one of the gateway from which it accepts replies.
    Path(PathBuf, Arc<UnixDatagram>),
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

    /// The sender of a datagram to `socket` whose process and user the kernel states.
    fn local(
        address: Option<PathBuf>,
        socket: Arc<UnixDatagram>,
        credentials: Option<UCred>,
    ) -> Option<Self> {
        let UCred { pid, uid, .. } = credentials?;
        let process = pid.as_raw_pid().unsigned_abs();
        let program = match (process, &address) {
            (0, Some(path)) => path.display().to_string(),
            _ => std::fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default(),
        };
        let address = address.map(|path| SenderAddress::Path(path, socket));
        let program = program.trim().to_owned();
        Some(Self { address, process, user: uid.as_raw(), program })
    }
}

/// The socket, whose file is removed with this object, and made again after another process removed it.
#[derive(Debug)]
pub struct UnixGateway {
    path: PathBuf,
    bound: Mutex<BoundSockets>,
}

/// The socket with its file, and the ones before.
#[derive(Debug)]
struct BoundSockets {
    file: KeptFile,
    /// The newest first. Programs that connected to one before its file was removed still send to it.
    sockets: Vec<Arc<UnixDatagram>>,
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
        let mut file = KeptFile::new(path.to_owned());
        let sockets = vec![file.make(bound).map_err(failed)?];
        Ok(Self { path: path.to_owned(), bound: Mutex::new(BoundSockets { file, sockets }) })
    }

    /// The sockets, the newest first.
    fn sockets(&self) -> Vec<Arc<UnixDatagram>> {
        self.bound.lock().unwrap_or_else(PoisonError::into_inner).sockets.clone()
    }

    /// Creates the file again if it was removed.
    fn renew(&self) {
        let mut present = self.bound.lock().unwrap_or_else(PoisonError::into_inner);
        let BoundSockets { file, sockets } = &mut *present;
        if file.is_due(Time::now())
            && let Some(socket) = file.renew(bound, |line| say(&format!("oqtal: {line}")))
        {
            sockets.insert(0, socket);
            sockets.truncate(MOST_SOCKETS);
        }
    }

    /// Takes the next datagram of `socket`; `None` if none waits.
    fn receive_from(
        &self,
        socket: &Arc<UnixDatagram>,
        datagram: &mut [u8],
    ) -> Result<Option<Incoming>, Failure> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmCredentials(1))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let mut parts = [IoSliceMut::new(datagram)];
        let received = match recvmsg(socket, &mut parts, &mut control, RecvFlags::DONTWAIT) {
            Ok(received) => received,
            Err(Errno::AGAIN) => return Ok(None),
            Err(Errno::INTR) => return Ok(Some(Incoming::Ignored)),
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
        let sender = Sender::local(address, Arc::clone(socket), credentials);
        Ok(Some(sender.map_or(Incoming::Ignored, |sender| {
            Incoming::Datagram(Received { content: 0..received.bytes, sender })
        })))
    }
}

/// Waits until one of `sockets` has a datagram, with a time-out.
pub fn wait_for_datagram(sockets: &[impl AsFd]) {
    let poll_fd = |socket| PollFd::from_borrowed_fd(AsFd::as_fd(socket), PollFlags::IN);
    let mut polled: Vec<_> = sockets.iter().map(poll_fd).collect();
    // After an error the next wait follows at once.
    let _ = poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: TIMEOUT_NS }));
}

/// A socket bound to `path`, mode 0600.
fn bound(path: &Path) -> io::Result<Arc<UnixDatagram>> {
    let socket = UnixDatagram::bind(path)?;
    std::fs::set_permissions(path, Permissions::from_mode(0o600))?;
    sockopt::set_socket_passcred(&socket, true)?;
    Ok(Arc::new(socket))
}

impl GatewaySocket for UnixGateway {
    fn address(&self) -> String {
        self.path.display().to_string()
    }

    fn receive(&self, datagram: &mut [u8]) -> Result<Incoming, Failure> {
        for socket in self.sockets() {
            if let Some(reception) = self.receive_from(&socket, datagram)? {
                return Ok(reception);
            }
        }
        Ok(Incoming::Empty)
    }

    fn wait(&self) {
        self.renew();
        wait_for_datagram(&self.sockets());
    }

    fn reply(&self, sender: &Sender, text: &str) {
        let Some(SenderAddress::Path(path, socket)) = &sender.address else { return };
        if let Ok(address) = SocketAddrUnix::new(path) {
            let _ = sendto(socket, text.as_bytes(), SendFlags::DONTWAIT, &address);
        }
    }
}

impl Drop for UnixGateway {
    fn drop(&mut self) {
        self.bound.lock().unwrap_or_else(PoisonError::into_inner).file.remove();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_reach_the_gateway_after_its_socket_was_removed_also_those_connected_before() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("gateway.sock");
        let gateway = UnixGateway::bind(&path).unwrap();
        let program = |name| {
            let program = UnixDatagram::bind(directory.path().join(name)).unwrap();
            program.connect(&path).unwrap();
            program
        };
        let before = program("before");
        std::fs::remove_file(&path).unwrap();
        let mut datagram = [0; 16];
        gateway.wait();
        assert!(matches!(gateway.receive(&mut datagram), Ok(Incoming::Empty)));
        let after = program("after");
        for program in [before, after] {
            program.send(b"ask").unwrap();
            let Ok(Incoming::Datagram(received)) = gateway.receive(&mut datagram) else {
                panic!("no datagram")
            };
            assert_eq!(&datagram[received.content], b"ask");
            gateway.reply(&received.sender, "answer");
            let length = program.recv(&mut datagram).unwrap();
            assert_eq!(&datagram[..length], b"answer");
        }
        drop(gateway);
        assert!(!path.exists());
    }
}
