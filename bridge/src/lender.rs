//! The socket at which a bridge lends its port to a tenant, for the background thread: it passes on descriptors of the port and of the
//! lease, and notices the end of the tenant by that of the connection.

use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;

use oqtal_bus::lease::PortLease;
use oqtal_runtime::packet_socket::{PacketListener, is_connected, send};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::{CrtpLink, LinkSpec};
use oqtal_wire::xbee::Framing;
use rustix::net::UCred;
use rustix::process::{PidfdFlags, pidfd_open};

use crate::link::VehicleLink;
use crate::tenant::{PortPart, PortTenant};

/// Lends the port.
#[derive(Debug)]
pub struct PortLender {
    listener: PacketListener,
    spec: LinkSpec,
    /// A second descriptor of the port; `None` while it is lost, or if it has none.
    port: Option<OwnedFd>,
    /// Connection of the tenant.
    tenant: Option<OwnedFd>,
    /// Whether the loop has a tenant, and whether it knows that this one has left.
    is_lent: bool,
    is_announced: bool,
}

impl PortLender {
    /// Lends `link`, the port at `spec`, to a tenant that connects at `path`.
    ///
    /// # Errors
    /// The socket cannot be made (exit code 71).
    pub fn open(path: PathBuf, spec: LinkSpec, link: &dyn VehicleLink) -> Result<Self, Failure> {
        let failed = format!("making the socket {} failed", path.display());
        let listener = PacketListener::open(path)
            .map_err(|error| Failure::new(Exit::System, format!("{failed}: {error}")))?;
        let (is_lent, is_announced) = (false, false);
        let mut lender = Self { listener, spec, port: None, tenant: None, is_lent, is_announced };
        lender.set_port(link);
        Ok(lender)
    }

    /// Lends `link` from now on.
    pub fn set_port(&mut self, link: &dyn VehicleLink) {
        self.port = link.descriptor().and_then(|port| port.try_clone_to_owned().ok());
    }

    /// Ends the tenancy of a port that is lost.
    pub fn lose_port(&mut self) {
        (self.port, self.tenant) = (None, None);
    }

    /// Takes the port back, whose tenant has left.
    pub fn take_back(&mut self) {
        (self.is_lent, self.is_announced) = (false, false);
    }

    /// Notices the end of a tenant, and accepts one; returns what the loop has to know.
    pub fn poll(&mut self) -> Option<PortPart> {
        if self.tenant.as_ref().is_some_and(|connection| !is_connected(connection)) {
            tracing::info!("the chain has left");
            self.tenant = None;
        }
        if self.is_lent && self.tenant.is_none() && !self.is_announced {
            self.is_announced = true;
            return Some(PortPart::NoTenant);
        }
        let (connection, peer) = self.listener.accept()?;
        match self.lend(&connection, &peer) {
            Ok(tenant) => {
                tracing::info!(pid = ?peer.pid, "a chain sends the flight commands");
                (self.tenant, self.is_lent) = (Some(connection), true);
                Some(PortPart::Tenant(Box::new(tenant)))
            }
            Err(reason) => {
                tracing::warn!(pid = ?peer.pid, "a chain was refused: {reason}");
                // It may have ended.
                let _ = send(&connection, &reason, &[]);
                None
            }
        }
    }

    /// Lends the port to the process `peer`; or else the reason, with its remedy.
    fn lend(&self, connection: &OwnedFd, peer: &UCred) -> Result<PortTenant, String> {
        let spec = &self.spec;
        if !can_be_lent(spec) {
            return Err(format!(
                "the bridge cannot lend {spec}, only asctec without an XBee in API mode, mavlink, and crtp:udp; run `oqtal receiver run` and `oqtal daemon run` in place of the chain, or `oqtal fly` without --chain"
            ));
        }
        if self.is_lent {
            return Err("another chain has the port of the bridge; end that one first".to_owned());
        }
        // A bridge can kill only processes of its own user.
        if peer.uid != rustix::process::geteuid() {
            return Err("the chain must run as the user of the bridge".to_owned());
        }
        let Some(port) = &self.port else {
            return Err(format!("the bridge has lost its port, {spec}; see its log"));
        };
        let system = |error: std::io::Error| format!("lending the port failed: {error}");
        let process = pidfd_open(peer.pid, PidfdFlags::empty()).map_err(|e| system(e.into()))?;
        let lease = PortLease::create().map_err(system)?;
        send(connection, &spec.to_string(), &[port.as_fd(), lease.descriptor()]).map_err(system)?;
        Ok(PortTenant::new(lease, process))
    }
}

/// Whether frames of flight commands can be written to a port at `spec` without its bridge: not those that the vehicle must have
/// answered before the next one, nor those in numbered packets, nor over a radio that a thread of the bridge serves.
fn can_be_lent(spec: &LinkSpec) -> bool {
    match spec {
        LinkSpec::Asctec(link) => link.xbee == Framing::Transparent,
        LinkSpec::Crtp(link) => matches!(link, CrtpLink::Udp(_)),
        LinkSpec::Mavlink(_) => true,
        LinkSpec::Msp(_) => false,
    }
}
