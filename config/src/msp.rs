//! `[bridge.msp]` and `[plant.wire.msp]`: a Betaflight vehicle, at either end of MSP.

use serde::{Deserialize, Serialize};

/// `[bridge.msp]` and `[plant.wire.msp]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MspOptions {
    /// Points `[delta_c, throttle]` from the fraction of maximum thrust to the throttle of the remote control \[-\].
    pub thrust_table: Vec<[f64; 2]>,
}
