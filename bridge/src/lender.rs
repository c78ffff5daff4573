//! The socket at which a bridge lends its port to a tenant, for the background thread. It passes on descriptors of the port and of the
//! lease; the end of the connection is the end of the tenancy.

use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;

use oqtal_bus::lease::PortLease;
use oqtal_runtime::packet_socket::{PacketListener, is_connected, receive, send};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::{CrtpLink, LinkSpec};
use oqtal_wire::xbee::Framing;
use rustix::net::UCred;
use rustix::process::{PidfdFlags, pidfd_open};

use crate::link::VehicleLink;
use crate::tenant::{PortPart, PortTenant};

/// Longest wait for the first packet of a chain, which it sends when it connects \[ms\].
const REQUEST_TIMEOUT_MS: i64 = 100;

/// Lends the port.
#[derive(Debug)]
pub struct PortLender {
    listener: PacketListener,
    spec: LinkSpec,
    /// Fingerprint of the key that signs packets.
    key: String,
    /// A second descriptor of the port; `None` while it is lost, or if it has none.
    port: Option<OwnedFd>,
    /// Connection of the tenant.
    tenant: Option<OwnedFd>,
    /// Whether the loop has a tenant, and whether the loop was informed that the tenant has left.
    is_lent: bool,
    is_announced: bool,
    /// Reason of the last refusal: it is logged once, since a chain tries again ten times a second.
    refusal: String,
}

impl PortLender {
    /// Lends `link`, the port at `spec`, to a tenant that connects at `path` and signs packets with the key of this fingerprint.
    ///
    /// # Errors
    /// The socket cannot be made (exit code 71).
    pub fn open(
        path: PathBuf,
        spec: LinkSpec,
        key: String,
        link: &dyn VehicleLink,
    ) -> Result<Self, Failure> {
        let failed = format!("making the socket {} failed", path.display());
        let listener = PacketListener::open(path)
            .map_err(|error| Failure::new(Exit::System, format!("{failed}: {error}")))?;
        let mut lender = Self {
            listener,
            spec,
            key,
            port: None,
            tenant: None,
            is_lent: false,
            is_announced: false,
            refusal: String::new(),
        };
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

    /// Takes the port back from a tenant that has left.
    pub fn take_back(&mut self) {
        (self.is_lent, self.is_announced) = (false, false);
    }

    /// Detects the end of a tenancy, and accepts a new tenant; returns the change for the loop.
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
                self.refusal.clear();
                Some(PortPart::Tenant(Box::new(tenant)))
            }
            Err(reason) => {
                // The chain may have ended.
                let _ = send(&connection, &reason, &[]);
                if reason != self.refusal {
                    tracing::warn!(pid = ?peer.pid, "a chain was refused: {reason}");
                    self.refusal = reason;
                }
                None
            }
        }
    }

    /// Lends the port to the process `peer`; or else the reason, with its remedy.
    fn lend(&self, connection: &OwnedFd, peer: &UCred) -> Result<PortTenant, String> {
        let spec = &self.spec;
        // Read first: a connection that is closed with unread packets loses the answer.
        let (key, _) = receive(connection, REQUEST_TIMEOUT_MS).map_err(|error| {
            format!(
                "the chain sent no request: {error}; bridge and chain must be of the same build"
            )
        })?;
        if !can_be_lent(spec) {
            return Err(format!(
                "the bridge cannot lend {spec}, only asctec without an XBee in API mode, mavlink, and crtp:udp; run `oqtal receiver run` and `oqtal daemon run` in place of the chain, or `oqtal fly` without --chain"
            ));
        }
        if self.is_lent {
            return Err("another chain has the port of the bridge; end that one first".to_owned());
        }
        if matches!(spec, LinkSpec::Mavlink(_)) && key != self.key {
            return Err(
                "the chain has another key in `bridge.mavlink.signing-key-file` than the bridge; give both the same file"
                    .to_owned(),
            );
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

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;

    use oqtal_config::{Config, Setting};
    use oqtal_wire::link::HostPort;

    use super::*;
    use crate::borrower::PortBorrower;
    use crate::link::PortOptions;
    use crate::options;
    use crate::udp::UdpPortOptions;

    /// Configuration of a bridge or a chain with the key in the file at `path`.
    fn config_of(path: &Path) -> Config {
        let key = "bridge.mavlink.signing-key-file";
        let setting = Setting::flag("test", key, path.display().to_string().as_str());
        Config::from_settings(&[setting]).unwrap()
    }

    fn directory(name: &str) -> PathBuf {
        let name = format!("oqtal-lender-{name}-{}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        fs::create_dir_all(&directory).unwrap();
        directory
    }

    /// A lender at `path`, of a bridge with the key of `config`.
    fn lender(path: &Path, config: &Config) -> PortLender {
        let host = HostPort { host: "127.0.0.1".to_owned(), port: 0 };
        let link = UdpPortOptions::In(host).open().unwrap();
        let spec = "mavlink:udpin:127.0.0.1:14550".parse().unwrap();
        let key = options::key_fingerprint(config);
        PortLender::open(path.to_owned(), spec, key, &*link).unwrap()
    }

    /// Answer of `lender` at `path` to a chain under `config`.
    fn answer(lender: &mut PortLender, path: &Path, config: &Config) -> Result<(), String> {
        std::thread::scope(|threads| {
            let open = || PortBorrower::open(path, config).map(drop);
            let chain = threads.spawn(move || open().map_err(|failure| failure.message));
            while !chain.is_finished() {
                lender.poll();
                std::thread::yield_now();
            }
            chain.join().unwrap()
        })
    }

    #[test]
    fn a_chain_that_signs_with_another_key_than_the_bridge_is_refused() {
        let directory = directory("key");
        let [one, other] = ["ab", "cd"].map(|digits| {
            let path = directory.join(digits);
            fs::write(&path, digits.repeat(32)).unwrap();
            fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
            config_of(&path)
        });
        let path = directory.join("chain");
        let mut lender = lender(&path, &one);
        for config in [&other, &Config::default()] {
            let refusal = answer(&mut lender, &path, config).unwrap_err();
            assert!(refusal.contains("signing-key-file"), "{refusal}");
        }
        assert_eq!(answer(&mut lender, &path, &one), Ok(()));
        fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn a_chain_gets_the_port_after_the_socket_was_removed() {
        let (directory, config) = (directory("removed"), Config::default());
        let path = directory.join("chain");
        let mut lender = lender(&path, &config);
        fs::remove_file(&path).unwrap();
        assert!(lender.poll().is_none());
        assert_eq!(answer(&mut lender, &path, &config), Ok(()));
        fs::remove_dir_all(&directory).unwrap();
    }
}
