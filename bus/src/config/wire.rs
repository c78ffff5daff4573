//! `[vehicle.wire]`: the emulated vehicle at the other end of a wire, and the radio on the way to it.

use serde::{Deserialize, Serialize};

use super::{Violation, not_negative, positive, probability};

/// `[vehicle.wire]`. A command that comes over it acts `vehicle.radio-delay-ms` after its first byte, as one that comes over the bus
/// acts so long after it was received: what its bytes do not take, the radio's latency does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Wire {
    /// `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`: PATH becomes a symbolic link to a pseudo-terminal; empty for no
    /// wire, with commands off the bus.
    pub link: String,
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
    pub(super) fn check(&self) -> Result<(), Violation> {
        probability("vehicle.wire.loss-probability", self.loss_probability)?;
        probability("vehicle.wire.bit-error-rate", self.bit_error_rate)?;
        not_negative("vehicle.wire.motor-switch-ms", self.motor_switch_ms)?;
        positive("vehicle.wire.time-out-ms", self.time_out_ms)?;
        positive("vehicle.wire.attitude-gain-per-s", self.attitude_gain_per_s)
    }
}
