//! A serial port as a link.
//!
//! The `serialport` crate opens, configures and locks it (`TIOCEXCL` and `flock`: whoever uses the lock, be it on a
//! pseudo-terminal or as root, is refused). Its reads and writes wait, so bytes go through a descriptor of our own that never
//! does.
//!
//! A USB adapter collects what it received for up to 16 ms; where the kernel lets that be set, it is looked at, and said.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use oqtal_runtime::process::{Exit, Failure};
use rustix::fs::OFlags;
use serialport::{ClearBuffer, FlowControl, SerialPort, TTYPort};

use crate::link::VehicleLink;

/// An adapter that holds bytes back for longer is worth a word \[ms\].
const GOOD_LATENCY_MS: u32 = 1;

/// Which port, and how.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialPortOptions {
    /// Its path; a symbolic link is followed anew at each opening.
    pub path: PathBuf,
    /// Its speed \[baud\].
    pub baud: u32,
    /// Whether RTS and CTS hold the other end back.
    pub hardware_flow_control: bool,
}

/// Why a port cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum PortOpenError {
    /// There is none at this path.
    #[error("no serial port at {path}; plug it in, or name another in `bridge.link` or --link")]
    Missing {
        /// The port.
        path: String,
    },
    /// It belongs to somebody else.
    #[error("no permission for {path}; add the user to the group that owns it (often `dialout`)")]
    Permission {
        /// The port.
        path: String,
    },
    /// Another process has it.
    #[error("{path} is used by another process, perhaps a second bridge; stop that one first")]
    Busy {
        /// The port.
        path: String,
    },
    /// It is something else.
    #[error("{path} is not a serial port; name one in `bridge.link` or --link")]
    NotATerminal {
        /// The path.
        path: String,
    },
    /// The operating system refused otherwise.
    #[error("opening {path} at {baud} baud failed: {reason}")]
    System {
        /// The port.
        path: String,
        /// The speed asked for.
        baud: u32,
        /// What came back.
        reason: String,
    },
}

impl From<PortOpenError> for Failure {
    fn from(error: PortOpenError) -> Self {
        let exit = match error {
            PortOpenError::Permission { .. } => Exit::Permission,
            PortOpenError::Busy { .. } => Exit::Peer,
            PortOpenError::Missing { .. } | PortOpenError::NotATerminal { .. } => Exit::System,
            PortOpenError::System { .. } => Exit::System,
        };
        Self::new(exit, error.to_string())
    }
}

/// An open serial port.
#[derive(Debug)]
pub struct SerialLink {
    // In this setpoint: the lock is given back last.
    bytes: File,
    control: TTYPort,
}

impl SerialPortOptions {
    /// Opens the port. May take long: never on the loop's thread.
    ///
    /// # Errors
    /// There is none, it is taken, or the operating system refuses.
    pub fn open(&self) -> Result<SerialLink, PortOpenError> {
        // Both descriptors are of the same device, even if the link is changed in between.
        let device =
            self.path.canonicalize().map_err(|error| self.refused(error.kind(), &error))?;
        let flags = OFlags::NOCTTY | OFlags::NONBLOCK;
        let bytes = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(flags.bits().cast_signed())
            .open(&device)
            .map_err(|error| self.refused(error.kind(), &error))?;
        if !bytes.is_terminal() {
            return Err(PortOpenError::NotATerminal { path: self.name() });
        }
        let flow =
            if self.hardware_flow_control { FlowControl::Hardware } else { FlowControl::None };
        let builder = serialport::new(device.to_string_lossy(), self.baud).flow_control(flow);
        let control = TTYPort::open(&builder).map_err(|error| match error.kind() {
            serialport::ErrorKind::NoDevice => PortOpenError::Busy { path: self.name() },
            serialport::ErrorKind::Io(kind) => self.refused(kind, &error),
            _ => self.refused(ErrorKind::Other, &error),
        })?;
        // What was received before belongs to nobody.
        control
            .clear(ClearBuffer::Input)
            .map_err(|error| self.refused(ErrorKind::Other, &error))?;
        warn_of_latency(&device);
        Ok(SerialLink { bytes, control })
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn refused(&self, kind: ErrorKind, reason: &dyn std::fmt::Display) -> PortOpenError {
        let path = self.name();
        match kind {
            ErrorKind::NotFound => PortOpenError::Missing { path },
            ErrorKind::PermissionDenied => PortOpenError::Permission { path },
            ErrorKind::ResourceBusy => PortOpenError::Busy { path },
            ErrorKind::IsADirectory => PortOpenError::NotATerminal { path },
            _ => PortOpenError::System { path, baud: self.baud, reason: reason.to_string() },
        }
    }
}

impl VehicleLink for SerialLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.bytes.read(buffer) {
            // The end of a terminal is the end of the line.
            Ok(0) => Err(ErrorKind::BrokenPipe.into()),
            other => nothing_now(other),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        nothing_now(self.bytes.write(bytes))
    }

    fn queued(&self) -> io::Result<usize> {
        let bytes = self.control.bytes_to_write()?;
        Ok(usize::try_from(bytes).unwrap_or(usize::MAX))
    }

    fn discard(&mut self) -> io::Result<()> {
        Ok(self.control.clear(ClearBuffer::Output)?)
    }
}

/// What would have to wait is nothing for now.
fn nothing_now(result: io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(0)
        }
        other => other,
    }
}

/// Says so if a USB adapter holds back what it receives.
fn warn_of_latency(device: &Path) {
    let Some(name) = device.file_name() else { return };
    let file = Path::new("/sys/class/tty").join(name).join("device/latency_timer");
    let held_ms = std::fs::read_to_string(&file).ok().and_then(|text| text.trim().parse().ok());
    if held_ms.is_some_and(|held_ms: u32| held_ms > GOOD_LATENCY_MS) {
        tracing::warn!(
            "the adapter holds telemetry back for up to {} ms: write {GOOD_LATENCY_MS} into {}, as the udev rule does",
            held_ms.unwrap_or_default(),
            file.display()
        );
    }
}
