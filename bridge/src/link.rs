//! Interface to the port to a vehicle: a stream such as a serial port, or packets such as datagrams. A link is independent of formats and
//! set-points; there is one implementation per kind of port.

use std::fmt::Debug;
use std::io::{self, ErrorKind};
use std::os::fd::BorrowedFd;

use oqtal_runtime::process::{Exit, Failure};

/// Port that can be opened.
pub trait PortOptions: Debug + Send + Sync {
    /// Opens the port. May take long: not for the real-time thread.
    ///
    /// # Errors
    /// There is no such port, it is in use, or the operating system refuses.
    fn open(&self) -> Result<Box<dyn VehicleLink>, PortOpenError>;
}

/// Open port, both ways. No method blocks.
///
/// A stream has no frame boundaries: a read returns the available bytes, a write may take part of a frame. On a packet link, a
/// read returns one packet, and a write of one frame sends one packet or nothing.
pub trait VehicleLink: Debug + Send {
    /// Reads received bytes, or one packet, into `buffer`, which holds the longest frame; 0 if there is none.
    ///
    /// # Errors
    /// The link is lost.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Writes the rest of one frame; returns the number of bytes taken, 0 if the port takes none now.
    ///
    /// # Errors
    /// The link is lost.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Number of written bytes that have not left the machine, as far as the operating system reports it; 0 for a port without a
    /// queue.
    ///
    /// # Errors
    /// The link is lost.
    fn queued(&self) -> io::Result<usize>;

    /// Discards the bytes that have not left the machine.
    ///
    /// # Errors
    /// The link is lost.
    fn discard(&mut self) -> io::Result<()>;

    /// Descriptor through which another process can write frames to the port; `None` if there is none.
    fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Sets whether a port that takes its peer from arriving datagrams keeps the present peer, because the vehicle answers. Called before
    /// reads.
    fn keep_peer(&mut self, _is_kept: bool) {}
}

/// `result`, with 0 bytes in place of a call that would block.
pub(crate) fn without_waiting(result: io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(0)
        }
        other => other,
    }
}

/// Failure to open a port.
#[derive(Debug, thiserror::Error)]
pub enum PortOpenError {
    /// Nothing exists at the path.
    #[error("no serial port at {path}; plug it in, or name another link")]
    Missing {
        /// Path of the port.
        path: String,
    },
    /// The user may not open the port.
    #[error("no permission for {path}; add the user to the group that owns it (often `dialout`)")]
    Permission {
        /// Path of the port.
        path: String,
    },
    /// No Crazyradio is plugged in.
    #[error("no Crazyradio is plugged in; plug one in; a vehicle at crtp:udp:HOST:PORT needs none")]
    NoCrazyradio,
    /// The user may not open the Crazyradio.
    #[error(
        "no permission for the Crazyradio; copy deploy/udev/71-oqtal-crazyradio.rules to /etc/udev/rules.d, add the user to the \
         group `plugdev`, log in again and plug the radio in again"
    )]
    CrazyradioPermission,
    /// Another program uses the Crazyradio.
    #[error(
        "the Crazyradio is used by another program; stop that one first, or share the radio among bridges with `oqtal bridge radio`"
    )]
    CrazyradioBusy,
    /// The firmware of the Crazyradio is too old.
    #[error("the Crazyradio has firmware {}.{:x}; update it to 0.5 or later", version >> 8, (version >> 4) & 0xF)]
    OldCrazyradio {
        /// Version as USB states it, binary coded decimal \[-\].
        version: u16,
    },
    /// Another process has locked the port.
    #[error(
        "{path} is used by another process, perhaps a second bridge or `oqtal chain`; stop that one first"
    )]
    Busy {
        /// Path of the port.
        path: String,
    },
    /// The path leads to something other than a serial port.
    #[error("{path} is not a serial port; name another link")]
    NotATerminal {
        /// The path.
        path: String,
    },
    /// Another program listens at the address.
    #[error(
        "{address} is used by another program on this machine, perhaps a second bridge, `oqtal chain` or a ground station; stop that one, or \
         name another port"
    )]
    AddressInUse {
        /// Host and port.
        address: String,
    },
    /// The address is of another machine, or of an interface that is down.
    #[error(
        "{address} is not an address of this machine; name one of its own, as 0.0.0.0 for all, or use \
         `udpout` for the address of the vehicle"
    )]
    NotLocal {
        /// Host and port.
        address: String,
    },
    /// No server at the address.
    #[error(
        "no server accepts a connection at {address}; switch the vehicle on, or name another link"
    )]
    NoServer {
        /// Host and port.
        address: String,
    },
    /// The host has no address.
    #[error("no host `{host}`: {reason}; name another link")]
    UnknownHost {
        /// Name of the host.
        host: String,
        /// Message of the operating system.
        reason: String,
    },
    /// The operating system refused for another reason.
    #[error("opening {port} failed: {reason}")]
    System {
        /// Path and speed, or address, of the port.
        port: String,
        /// Message of the operating system.
        reason: String,
    },
}

impl PortOpenError {
    /// The failure of `oqtal bridge run`, which has a key and a flag for the link.
    pub(crate) fn of_run(self) -> Failure {
        let has_other_link = matches!(
            self,
            Self::Missing { .. }
                | Self::NoCrazyradio
                | Self::NotATerminal { .. }
                | Self::AddressInUse { .. }
                | Self::NotLocal { .. }
                | Self::NoServer { .. }
                | Self::UnknownHost { .. }
        );
        let Failure { exit, message } = self.into();
        let place = if has_other_link {
            "; the link is set by `bridge.link`, --link, or `oqtal fly --vehicle link:…`"
        } else {
            ""
        };
        Failure::new(exit, message + place)
    }
}

impl From<PortOpenError> for Failure {
    fn from(error: PortOpenError) -> Self {
        let exit = match error {
            PortOpenError::Permission { .. } | PortOpenError::CrazyradioPermission => {
                Exit::Permission
            }
            PortOpenError::Busy { .. }
            | PortOpenError::AddressInUse { .. }
            | PortOpenError::CrazyradioBusy => Exit::Peer,
            PortOpenError::Missing { .. }
            | PortOpenError::NoCrazyradio
            | PortOpenError::OldCrazyradio { .. }
            | PortOpenError::NotATerminal { .. }
            | PortOpenError::NotLocal { .. }
            | PortOpenError::NoServer { .. }
            | PortOpenError::UnknownHost { .. }
            | PortOpenError::System { .. } => Exit::System,
        };
        Self::new(exit, error.to_string())
    }
}
