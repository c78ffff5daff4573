//! `[vehicle.wire]`: the emulated vehicle at the other end of a wire, and the radio on the way to it.

use oqtal_wire::link::LinkSpec;
use serde::{Deserialize, Serialize};

use crate::{Violation, link_at, not_negative, positive, probability};

/// `[vehicle.wire]`. With the defaults a command acts as long after its first byte as one that comes over the bus acts after it was
/// received, `vehicle.radio-delay-ms`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Wire {
    /// `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`: PATH becomes a symbolic link to a pseudo-terminal; empty for no
    /// wire, with commands off the bus.
    pub link: String,
    /// From a byte's last bit to its arrival, each way \[ms\].
    pub latency_ms: f64,
    /// Whether the two ends take turns on the air.
    pub half_duplex: bool,
    /// Probability that a frame is lost, each way.
    pub loss_probability: f64,
    /// Probability that a bit is wrong, each way, independent of others.
    pub bit_error_rate: f64,
    /// No thrust and full yaw held for so long start the motors, and stop them \[ms\].
    pub motor_switch_ms: f64,
    /// Without a command for so long the vehicle stops its motors \[ms\].
    pub time_out_ms: f64,
    /// From an angle that is off to a body rate \[1/s\], where sticks mean an attitude.
    pub attitude_gain_per_s: f64,
}

impl Wire {
    /// The link that is named; `None` if none is.
    ///
    /// # Errors
    /// The text is no link.
    pub fn link(&self) -> Result<Option<LinkSpec>, Violation> {
        link_at("vehicle.wire.link", &self.link)
    }

    pub(crate) fn check(&self) -> Result<(), Violation> {
        self.link()?;
        not_negative("vehicle.wire.latency-ms", self.latency_ms)?;
        probability("vehicle.wire.loss-probability", self.loss_probability)?;
        probability("vehicle.wire.bit-error-rate", self.bit_error_rate)?;
        not_negative("vehicle.wire.motor-switch-ms", self.motor_switch_ms)?;
        positive("vehicle.wire.time-out-ms", self.time_out_ms)?;
        positive("vehicle.wire.attitude-gain-per-s", self.attitude_gain_per_s)
    }
}
