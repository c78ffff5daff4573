//! `[mocap.serve]`: poses over the network, in the protocols of real camera systems.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// `[mocap.serve]`. The texts are parsed by mocap-emu.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ServeOptions {
    /// Protocols that are served, `qtm[:PORT],vrpn[:PORT],natnet[:PORT]`; empty for nothing.
    pub protocols: String,
    /// Address of this machine at which clients are served.
    pub listen: String,
    /// Name of the body.
    pub body: String,
    /// Version of NatNet.
    pub natnet_version: String,
    /// Group of NatNet's frames by multicast; empty for unicast alone.
    pub multicast: String,
    /// Whether the poses are also published on the bus; false if a receiver publishes them.
    pub publish: bool,
    /// Probability that a frame reaches no client \[-\].
    pub loss_probability: f64,
    /// Probability that a frame is sent twice \[-\].
    pub repeat_probability: f64,
    /// Probability that a frame is sent after the next one \[-\].
    pub swap_probability: f64,
}

impl ServeOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        let probability = Rule::Between(0.0, 1.0);
        check_options([
            ("loss-probability", self.loss_probability, probability),
            ("repeat-probability", self.repeat_probability, probability),
            ("swap-probability", self.swap_probability, probability),
        ])
    }
}
