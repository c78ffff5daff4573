//! The port of a bridge in another process, borrowed by this process as its tenant, which writes each flight set-point as soon as it is
//! computed. The bridge writes all other set-points, and those that the tenant could not write.

use std::fs::File;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use oqtal_bus::code::Actuation;
use oqtal_bus::lease::PortLease;
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::transport::DirectPath;
use oqtal_config::Config;
use oqtal_runtime::actuation::actuation_of;
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle, handoff};
use oqtal_runtime::packet_socket::{connect, is_connected, receive, send};
use oqtal_runtime::process::{Exit, Failure};

use crate::options;
use crate::protocol::VehicleProtocol;
use crate::safety::is_flight;
use crate::setpoint::VehicleSetpoint;
use crate::setup::VehicleSetup;

/// Longest wait for the answer of a bridge \[ms\].
const ANSWER_TIMEOUT_MS: i64 = 500;
/// Time between two attempts to borrow the port again.
const RETRY_PERIOD: Span = Span::from_millis(100);

/// A borrowed port.
#[derive(Debug)]
pub struct BorrowedPort {
    protocol: Box<dyn VehicleProtocol>,
    accepts: Actuation,
    lease: PortLease,
    port: OwnedFd,
}

impl BorrowedPort {
    /// Writes the set-point of the command `sequence`, if the port is offered.
    fn write(&mut self, sequence: u64, command: &CommandV1) {
        if !is_flight(command, self.accepts) {
            return;
        }
        let Some(encoder) = self.lease.take(Time::now, sequence) else { return };
        let now = Time::now();
        self.protocol.continue_encoder(&encoder);
        let frame = self.protocol.setpoint(now, &VehicleSetpoint::Fly(*command));
        let length = frame.bytes().len();
        self.lease.begin(sequence, length, &self.protocol.encoder_state().unwrap_or(encoder));
        let written =
            if length == 0 { Ok(0) } else { rustix::io::write(&self.port, frame.bytes()) };
        match written {
            // The bridge tries it again, and finds a port that is lost.
            Ok(0) | Err(_) => self.lease.abandon(sequence, length),
            Ok(count) => self.lease.end(Time::now(), count == length),
        }
    }
}

/// Writer of a borrowed port, for the loop.
#[derive(Debug)]
pub struct PortWriter {
    handle: RtHandle<(), Option<Box<BorrowedPort>>, Box<BorrowedPort>>,
    port: Option<Box<BorrowedPort>>,
}

impl DirectPath for PortWriter {
    fn transmit(&mut self, sequence: u64, command: &CommandV1) {
        if let Some(port) = self.handle.request()
            && let Some(before) = std::mem::replace(&mut self.port, port)
        {
            self.handle.reply(before);
        }
        if let Some(port) = &mut self.port {
            port.write(sequence, command);
        }
    }
}

/// Borrows the port, and borrows it again from a bridge that was restarted or has reopened its port.
#[derive(Debug)]
pub struct PortBorrower {
    handle: BackgroundHandle<(), Option<Box<BorrowedPort>>, Box<BorrowedPort>>,
    config: Config,
    path: PathBuf,
    connection: Option<OwnedFd>,
    next: Time,
}

impl PortBorrower {
    /// Borrows the port of the bridge that listens at `path`, for commands under `config`.
    ///
    /// # Errors
    /// There is no bridge, or it lends no port (exit code 75).
    pub fn open(path: &Path, config: &Config) -> Result<(Self, PortWriter), Failure> {
        let (connection, port) = borrow(path, config)?;
        let (loop_handle, handle) = handoff();
        let (config, connection) = (config.clone(), Some(connection));
        let borrower =
            Self { handle, config, path: path.to_owned(), connection, next: Time::UNSET };
        Ok((borrower, PortWriter { handle: loop_handle, port: Some(Box::new(port)) }))
    }
}

impl BackgroundWorker for PortBorrower {
    fn poll(&mut self) {
        // Closed here, not in the loop.
        drop(self.handle.replies().try_recv());
        if self.connection.as_ref().is_some_and(|connection| !is_connected(connection)) {
            tracing::warn!("the bridge has ended, or has lost its port");
            self.connection = None;
            let _ = self.handle.send(None);
        }
        let now = Time::now();
        if self.connection.is_some() || now < self.next {
            return;
        }
        self.next = now + RETRY_PERIOD;
        // The bridge logs why it lends no port.
        if let Ok((connection, port)) = borrow(&self.path, &self.config) {
            tracing::info!("the bridge lends its port again");
            self.connection = Some(connection);
            let _ = self.handle.send(Some(Box::new(port)));
        }
    }
}

/// The connection to the bridge at `path`, and its port. The bridge refuses a chain that signs packets with another key.
fn borrow(path: &Path, config: &Config) -> Result<(OwnedFd, BorrowedPort), Failure> {
    let peer = |reason: String| Failure::new(Exit::Peer, reason);
    let connection = connect(path).map_err(|error| {
        peer(format!("no bridge lends its port at {}: {error}", path.display()))
    })?;
    let (text, descriptors) = send(&connection, &options::key_fingerprint(config), &[])
        .and_then(|()| receive(&connection, ANSWER_TIMEOUT_MS))
        .map_err(|error| peer(format!("the bridge at {}: {error}", path.display())))?;
    let Ok([port, lease]) = <[OwnedFd; 2]>::try_from(descriptors) else { return Err(peer(text)) };
    let lease = PortLease::of_file(File::from(lease))
        .map_err(|error| peer(format!("the bridge is of another version: {error}")))?;
    let mut config = config.clone();
    config.bridge.link = text;
    let protocol = VehicleSetup::of(&config)?.protocol;
    let accepts = actuation_of(config.vehicle.interface);
    Ok((connection, BorrowedPort { protocol, accepts, lease, port }))
}
