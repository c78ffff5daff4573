//! `[plant.wire]`: the emulated vehicle at the far end of a wire, and its radio.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

use crate::asctec::AsctecOptions;
use crate::crtp::CrtpVehicleOptions;
use crate::mavlink::PlantMavlinkOptions;
use crate::msp::MspOptions;

/// `[plant.wire]`. With the defaults the time from a command's first byte to its effect equals `plant.command-delay-ms`, the
/// delay of a command over the bus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PlantWireOptions {
    /// Link, `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`: PATH becomes a symbolic link to a pseudo-terminal; or
    /// `mavlink:udpout:HOST:PORT`, `mavlink:udpin:HOST:PORT`, `crtp:udp:HOST:PORT`, `msp:udpin:HOST:PORT`; empty for no wire, with commands off the bus. Parsed by plant-sim.
    pub link: String,
    /// Time from a byte's last bit to its arrival, each way \[ms\].
    pub latency_ms: f64,
    /// Greatest additional delay of a datagram, drawn uniformly for each \[ms\]; UDP only.
    pub jitter_ms: f64,
    /// Whether the two ends take turns in sending.
    pub half_duplex: bool,
    /// Probability that a frame is lost, each way \[0..1\].
    pub loss_probability: f64,
    /// Probability that a bit is wrong, each way, independent of others \[0..1\].
    pub bit_error_rate: f64,
    /// Time for which no thrust and full yaw must be held to start or stop the motors \[ms\].
    pub motor_switch_ms: f64,
    /// Time without a command after which the vehicle stops its motors, or an autopilot of MAVLink takes over \[ms\].
    pub time_out_ms: f64,
    /// The host's XBee as the vehicle addresses it, 4 or 16 hexadecimal digits; API modes only. Parsed by plant-sim.
    pub xbee_address: String,
    /// `[plant.wire.asctec]`: meaning of counts for the emulated vehicle.
    pub asctec: AsctecOptions,
    /// `[plant.wire.crtp]`: settings of an emulated Crazyflie.
    pub crtp: CrtpVehicleOptions,
    /// `[plant.wire.mavlink]`: the emulated autopilot.
    pub mavlink: PlantMavlinkOptions,
    /// `[plant.wire.msp]`: the emulated vehicle with Betaflight.
    pub msp: MspOptions,
}

impl PlantWireOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        self.crtp.check().map_err(|error| error.within("crtp"))?;
        check_options([
            ("latency-ms", self.latency_ms, Rule::NotNegative),
            ("jitter-ms", self.jitter_ms, Rule::NotNegative),
            ("loss-probability", self.loss_probability, Rule::Between(0.0, 1.0)),
            ("bit-error-rate", self.bit_error_rate, Rule::Between(0.0, 1.0)),
            ("motor-switch-ms", self.motor_switch_ms, Rule::NotNegative),
            ("time-out-ms", self.time_out_ms, Rule::Positive),
        ])
        .and_then(|()| self.mavlink.check())
    }
}
