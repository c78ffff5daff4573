//! Attempt to connect: its parameters for every protocol, and its result.

use std::io;
use std::net::{SocketAddr, TcpStream};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};

use crate::routes::{CameraBody, RouteTable};
use crate::stream::CameraStream;
use oqtal_wire::link::CameraLink;

/// Time within which a server must have answered all requests.
pub const CONNECT_TIMEOUT: Span = Span::from_millis(2500);

/// Open connection, with the server's description of itself.
#[derive(Debug)]
pub struct CameraConnection {
    /// The stream of frames.
    pub stream: Box<dyn CameraStream>,
    /// Program and version of the server.
    pub server: String,
    /// Bodies of the server.
    pub bodies: Vec<CameraBody>,
    /// Wanted bodies in the order of their routes; all if none was wanted.
    pub wanted: Vec<String>,
}

/// Failure to open a connection.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConnectError {
    /// The name of the host has no address.
    #[error(
        "no address for the host `{host}`: {reason}; check the name in `receiver.link`, or write the address"
    )]
    Host {
        /// The name.
        host: String,
        /// Message of the resolver.
        reason: String,
    },
    /// No server accepts connections at the address.
    #[error(
        "no {kind} server at {address}: {reason}; is it started, is its {kind} output switched on, is the port right, does a firewall allow it?"
    )]
    NoServer {
        /// Protocol.
        kind: &'static str,
        /// Address and port.
        address: String,
        /// Message of the operating system.
        reason: String,
    },
    /// The server uses another protocol.
    #[error("{address} does not use {kind}: {reason}; check the port in `receiver.link`")]
    OtherProtocol {
        /// Protocol.
        kind: &'static str,
        /// Address and port.
        address: String,
        /// Received data.
        reason: String,
    },
    /// The server supports other versions only.
    #[error("{address}: {reason}; update the camera software, or name a version that it supports")]
    Version {
        /// Address and port.
        address: String,
        /// Versions.
        reason: String,
    },
    /// The server accepts no further client, or does not answer.
    #[error(
        "the server at {address} refuses: {reason}; see its messages, end clients that are not needed"
    )]
    Refused {
        /// Address and port.
        address: String,
        /// The server's message.
        reason: String,
    },
    /// The server measures nothing.
    #[error("the server at {address} measures nothing; start its real-time measurement")]
    Idle {
        /// Address and port.
        address: String,
    },
    /// A wanted body is not among those of the server.
    #[error("no body `{name}` at {address}; {known}")]
    NoBody {
        /// The wanted name.
        name: String,
        /// Address and port.
        address: String,
        /// Text that lists the existing bodies.
        known: String,
    },
    /// Several bodies have the wanted name.
    #[error("several bodies `{name}` at {address}; give each body a name of its own there")]
    Ambiguous {
        /// The wanted name.
        name: String,
        /// Address and port.
        address: String,
    },
    /// A port of this machine is taken.
    #[error(
        "port {port} of this machine is used by another process: {reason}; stop that one first"
    )]
    PortInUse {
        /// The port \[-\].
        port: u16,
        /// Message of the operating system.
        reason: String,
    },
    /// The operating system does not permit it.
    #[error("no permission for {what}: {reason}; run as a user who may use the network")]
    Permission {
        /// Object of the refused operation.
        what: String,
        /// Message of the operating system.
        reason: String,
    },
}

impl From<ConnectError> for Failure {
    fn from(error: ConnectError) -> Self {
        let exit = match error {
            // Possibly temporary: a service manager restarts the receiver.
            ConnectError::Host { .. }
            | ConnectError::NoServer { .. }
            | ConnectError::Refused { .. }
            | ConnectError::Idle { .. }
            | ConnectError::NoBody { .. }
            | ConnectError::Ambiguous { .. } => Exit::System,
            ConnectError::OtherProtocol { .. } => Exit::Config,
            ConnectError::Version { .. } => Exit::Version,
            ConnectError::PortInUse { .. } => Exit::Peer,
            ConnectError::Permission { .. } => Exit::Permission,
        };
        Self::new(exit, error.to_string())
    }
}

/// Attempt to connect: link, address and deadline.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// The link.
    pub link: CameraLink,
    /// Address of the server.
    pub address: SocketAddr,
    /// End of the attempt.
    pub deadline: Time,
}

impl Attempt {
    /// Time until the deadline; at least a millisecond, since a socket treats zero as no time-out.
    pub fn left(&self) -> std::time::Duration {
        self.deadline.since(Time::now()).max(Span::from_millis(1)).to_duration()
    }

    /// Whether the time is up.
    pub fn is_over(&self) -> bool {
        Time::now() >= self.deadline
    }

    /// Routes of the wanted bodies.
    pub fn routes(&self) -> RouteTable {
        RouteTable::new(self.link.bodies.iter().map(|body| body.name.clone()).collect())
    }

    /// The failure of a call of the operating system.
    pub fn refused(&self, error: &io::Error) -> ConnectError {
        let (kind, address) = (self.link.protocol.name(), self.address.to_string());
        let reason = match error.kind() {
            io::ErrorKind::PermissionDenied => {
                return ConnectError::Permission { what: address, reason: error.to_string() };
            }
            io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => "no answer".to_owned(),
            _ => error.to_string(),
        };
        ConnectError::NoServer { kind, address, reason }
    }

    /// The failure of a server that does not answer.
    pub fn silent(&self, reason: &str) -> ConnectError {
        let (kind, address) = (self.link.protocol.name(), self.address.to_string());
        ConnectError::NoServer { kind, address, reason: reason.to_owned() }
    }

    /// The failure of a server that uses another protocol.
    pub fn other_protocol(&self, reason: impl ToString) -> ConnectError {
        let (kind, address) = (self.link.protocol.name(), self.address.to_string());
        ConnectError::OtherProtocol { kind, address, reason: reason.to_string() }
    }

    /// Opens a connection without delay of small packets.
    ///
    /// # Errors
    /// No server accepts it.
    pub fn tcp(&self) -> Result<TcpStream, ConnectError> {
        let stream = TcpStream::connect_timeout(&self.address, self.left());
        let stream = stream.map_err(|error| self.refused(&error))?;
        let ready =
            stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(self.left())));
        ready.map_err(|error| self.refused(&error))?;
        Ok(stream)
    }
}
