//! Opening a connection: may block, for at most the time given, and therefore never on the real-time thread.

use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::mpsc::channel;

use oqtal_bus::time::Time;

use crate::attempt::{Attempt, CONNECT_TIMEOUT, CameraConnection, ConnectError};
use crate::routes::CameraBody;
use crate::{natnet, qtm, vrpn};
use oqtal_wire::link::{CameraLink, CameraProtocol};

/// Most bodies that a message lists \[-\].
const MAX_LISTED: usize = 32;

/// Opens the connection of `link`.
///
/// # Errors
/// There is no usable server. A missing body is not an error.
pub fn connect(link: &CameraLink) -> Result<CameraConnection, ConnectError> {
    let deadline = Time::now() + CONNECT_TIMEOUT;
    let address = resolve(link)?;
    let attempt = Attempt { link: link.clone(), address, deadline };
    match link.protocol {
        CameraProtocol::Qtm { .. } => qtm::connect(&attempt),
        CameraProtocol::Vrpn => vrpn::connect(&attempt),
        CameraProtocol::Natnet { .. } => natnet::connect(&attempt),
    }
}

/// Opens the connection of `link` to a server that has all wanted bodies.
///
/// # Errors
/// The host is unknown, no server answers or it refuses, or a wanted body is not there, or is there twice.
pub fn connect_to_all(link: &CameraLink) -> Result<CameraConnection, ConnectError> {
    let mut connection = connect(link)?;
    let address = format!("{}:{}", link.host, link.port);
    if let Some(refused) = connection.stream.take_refused() {
        let name = connection.wanted[refused.route].clone();
        return Err(ConnectError::Ambiguous { name, address });
    }
    let missing = (0..connection.wanted.len()).find(|route| !connection.stream.has(*route));
    match missing {
        None => Ok(connection),
        Some(route) => Err(ConnectError::NoBody {
            name: connection.wanted[route].clone(),
            address,
            known: known(&connection.bodies),
        }),
    }
}

/// Text that lists the bodies.
pub fn known(bodies: &[CameraBody]) -> String {
    if bodies.is_empty() {
        return "it has none: define the vehicle as a rigid body there".to_owned();
    }
    let listed = bodies.iter().take(MAX_LISTED);
    let names: Vec<String> = listed.map(|body| format!("`{}`", body.name)).collect();
    let names = names.join(", ");
    match bodies.len().saturating_sub(MAX_LISTED) {
        0 => format!("there are {names}"),
        more => format!("there are {names} and {more} more"),
    }
}

/// The address of the host. A resolver may block for longer than the time-out, so it runs on its own thread.
fn resolve(link: &CameraLink) -> Result<SocketAddr, ConnectError> {
    let (host, port) = (link.host.clone(), link.port);
    let (answer, is_answered) = channel();
    std::thread::spawn(move || {
        let found = (host.as_str(), port).to_socket_addrs();
        // The first IPv4 address if there are several: camera systems listen there.
        let found = found.map(|found| {
            let all: Vec<SocketAddr> = found.collect();
            all.iter().find(|address| address.is_ipv4()).or(all.first()).copied()
        });
        let _ = answer.send(found);
    });
    let reason = match is_answered.recv_timeout(CONNECT_TIMEOUT.scaled(0.6).to_duration()) {
        Ok(Ok(Some(address))) => return Ok(address),
        Ok(Ok(None)) => "it has none".to_owned(),
        Ok(Err(error)) => error.to_string(),
        Err(_) => "the name service does not answer".to_owned(),
    };
    Err(ConnectError::Host { host: link.host.clone(), reason })
}
