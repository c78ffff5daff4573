//! Serial port as a link.
//!
//! The `serialport` crate opens, configures and locks the port by `TIOCEXCL` and `flock`: another process that honours the lock,
//! also on a pseudo-terminal or as root, is refused. The crate's reads and writes block, so bytes go through a second descriptor
//! that does not.
//!
//! A USB adapter buffers received bytes for up to 16 ms. Where the kernel exposes that time, a warning names it and the remedy.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use serialport::{ClearBuffer, FlowControl, SerialPort, TTYPort};

use crate::link::{PortOpenError, PortOptions, VehicleLink, without_waiting};

/// Buffering time of a USB adapter above which a warning is logged \[ms\].
const GOOD_LATENCY_MS: u32 = 1;

/// Path and settings of a serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialPortOptions {
    /// Path; a symbolic link is resolved each time the port is opened.
    pub path: PathBuf,
    /// Speed \[baud\].
    pub baud: u32,
    /// Whether RTS and CTS control the flow.
    pub hardware_flow_control: bool,
}

/// Open serial port.
#[derive(Debug)]
pub struct SerialLink {
    // Fields are dropped in this order: the lock is released last.
    bytes: File,
    control: TTYPort,
}

impl PortOptions for SerialPortOptions {
    fn open(&self) -> Result<Box<dyn VehicleLink>, PortOpenError> {
        // Resolved once: both descriptors are of the same device, even if the symbolic link changes in between.
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
        // Bytes received before are of another session.
        control
            .clear(ClearBuffer::Input)
            .map_err(|error| self.refused(ErrorKind::Other, &error))?;
        warn_of_latency(&device);
        Ok(Box::new(SerialLink { bytes, control }))
    }
}

impl SerialPortOptions {
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
            _ => PortOpenError::System {
                port: format!("{path} at {} baud", self.baud),
                reason: reason.to_string(),
            },
        }
    }
}

impl VehicleLink for SerialLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.bytes.read(buffer) {
            // A terminal at its end of file was closed or unplugged.
            Ok(0) => Err(ErrorKind::BrokenPipe.into()),
            other => without_waiting(other),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        without_waiting(self.bytes.write(bytes))
    }

    fn queued(&self) -> io::Result<usize> {
        let bytes = self.control.bytes_to_write()?;
        Ok(usize::try_from(bytes).unwrap_or(usize::MAX))
    }

    fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        Some(self.bytes.as_fd())
    }

    fn discard(&mut self) -> io::Result<()> {
        Ok(self.control.clear(ClearBuffer::Output)?)
    }
}

/// Warns of a USB adapter that buffers received bytes.
fn warn_of_latency(device: &Path) {
    let Some(name) = device.file_name() else { return };
    let file = Path::new("/sys/class/tty").join(name).join("device/latency_timer");
    let held_ms = std::fs::read_to_string(&file).ok().and_then(|text| text.trim().parse().ok());
    if held_ms.is_some_and(|held_ms: u32| held_ms > GOOD_LATENCY_MS) {
        tracing::warn!(
            "the adapter holds telemetry back for up to {} ms; write {GOOD_LATENCY_MS} into {}, as the udev rule does",
            held_ms.unwrap_or_default(),
            file.display()
        );
    }
}
