//! `[mocap.serve]`: poses over the network, in the protocols of real camera systems.

use serde::{Deserialize, Serialize};

/// `[mocap.serve]`. The texts are parsed by mocap-emu.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ServeOptions {
    /// What is served, `qtm[:PORT],vrpn[:PORT],natnet[:PORT]`; empty for nothing.
    pub protocols: String,
    /// Address of this machine at which clients are served.
    pub listen: String,
    /// Name of the body.
    pub body: String,
    /// Version of NatNet.
    pub natnet_version: String,
    /// Group of NatNet's frames by multicast; empty for unicast alone.
    pub multicast: String,
    /// Whether the poses are published on the bus as well; not where a receiver publishes them.
    pub publish: bool,
}
