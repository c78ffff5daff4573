//! Unix socket of packets (SOCK_SEQPACKET) in the directory of an instance, for other processes of the same user. A packet may pass on
//! descriptors.

use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use oqtal_bus::time::Time;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::Mode;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType, UCred, accept_with,
    bind, listen, recvmsg, sendmsg, socket_with, sockopt,
};

use crate::files;
use crate::kept_file::KeptFile;

/// Most descriptors of a packet \[-\].
const MAX_DESCRIPTORS: usize = 2;
/// Longest packet with descriptors \[bytes\].
const MAX_PACKET: usize = 1024;

/// A listening socket. Its file is removed with it, and made again after another process removed it.
#[derive(Debug)]
pub struct PacketListener {
    socket: OwnedFd,
    file: KeptFile,
}

impl PacketListener {
    /// Listens at `path`, for this user alone.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn open(path: PathBuf) -> io::Result<Self> {
        let mut file = KeptFile::new(path);
        let socket = file.make(bound)?;
        Ok(Self { socket, file })
    }

    /// The next connection of this user or of root, with the process at its other end; `None` if none waits.
    pub fn accept(&mut self) -> Option<(OwnedFd, UCred)> {
        if self.file.is_due(Time::now())
            && let Some(socket) = self.file.renew(bound, |line| tracing::warn!("{line}"))
        {
            self.socket = socket;
        }
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let connection = accept_with(&self.socket, flags).ok()?;
        let peer = sockopt::socket_peercred(&connection).ok()?;
        if peer.uid != rustix::process::geteuid() && !peer.uid.is_root() {
            let path = self.file.path().display();
            tracing::warn!(pid = ?peer.pid, "a process of another user was refused at {path}");
            return None;
        }
        Some((connection, peer))
    }
}

impl Drop for PacketListener {
    fn drop(&mut self) {
        self.file.remove();
    }
}

/// A listening socket at `path`, mode 0600.
fn bound(path: &Path) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    // The file gets the mode of the socket when it is made.
    rustix::fs::fchmod(&socket, Mode::RUSR | Mode::WUSR)?;
    // Bound and listening under another name: a process that waits for the file finds it listening.
    let mut unready = path.as_os_str().to_owned();
    unready.push("~");
    let unready = PathBuf::from(unready);
    files::remove(&unready)?;
    bind(&socket, &SocketAddrUnix::new(&unready)?)?;
    listen(&socket, 4)?;
    std::fs::rename(&unready, path)?;
    Ok(socket)
}

/// Connects to the socket at `path`; the connection does not block.
///
/// # Errors
/// No process listens there, or too many wait for one that hangs.
pub fn connect(path: &Path) -> io::Result<OwnedFd> {
    let (kind, flags) = (SocketType::SEQPACKET, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK);
    let socket = socket_with(AddressFamily::UNIX, kind, flags, None)?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket)
}

/// Whether the peer process holds the connection open.
pub fn is_connected(connection: &OwnedFd) -> bool {
    let mut polled = [PollFd::new(connection, PollFlags::RDHUP)];
    let none = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut polled, Some(&none)).is_ok()
        && !polled[0].revents().intersects(PollFlags::HUP | PollFlags::RDHUP | PollFlags::ERR)
}

/// Sends a packet of `text`, which is not empty, with at most two descriptors.
///
/// # Errors
/// The other end is closed, or has too many packets to read.
pub fn send(connection: &OwnedFd, text: &str, descriptors: &[BorrowedFd<'_>]) -> io::Result<()> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_DESCRIPTORS))];
    let mut control = SendAncillaryBuffer::new(&mut space);
    if !descriptors.is_empty() && !control.push(SendAncillaryMessage::ScmRights(descriptors)) {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
    sendmsg(connection, &[IoSlice::new(text.as_bytes())], &mut control, flags)?;
    Ok(())
}

/// Waits at most `timeout_ms` \[ms\] for a packet; returns its text and descriptors.
///
/// # Errors
/// None arrives, or the connection is closed.
pub fn receive(connection: &OwnedFd, timeout_ms: i64) -> io::Result<(String, Vec<OwnedFd>)> {
    let timeout = Timespec { tv_sec: timeout_ms / 1000, tv_nsec: timeout_ms % 1000 * 1_000_000 };
    if poll(&mut [PollFd::new(connection, PollFlags::IN)], Some(&timeout))? == 0 {
        return Err(io::ErrorKind::TimedOut.into());
    }
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_DESCRIPTORS))];
    let (mut control, mut packet) = (RecvAncillaryBuffer::new(&mut space), [0; MAX_PACKET]);
    let flags = RecvFlags::CMSG_CLOEXEC | RecvFlags::DONTWAIT;
    let received = recvmsg(connection, &mut [IoSliceMut::new(&mut packet)], &mut control, flags)?;
    if received.bytes == 0 {
        return Err(io::ErrorKind::ConnectionAborted.into());
    }
    let mut descriptors = Vec::new();
    for message in control.drain() {
        if let RecvAncillaryMessage::ScmRights(rights) = message {
            descriptors.extend(rights);
        }
    }
    Ok((String::from_utf8_lossy(&packet[..received.bytes]).into_owned(), descriptors))
}
