//! `[bridge]`: connection to a real vehicle.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

use crate::asctec::AsctecOptions;
use crate::crtp::CrtpOptions;
use crate::mavlink::MavlinkOptions;
use crate::msp::MspOptions;

/// Allowed command timeouts \[control periods\]: below the minimum, commands would arrive too late; above the maximum, the vehicle would
/// continue for too long.
const COMMAND_TIMEOUT_PERIODS: Rule = Rule::Between(1.5, 15.0);

/// `[bridge]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct BridgeOptions {
    /// Link to the vehicle, `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`, `mavlink:PORT[,…]`, `crtp:PORT` or `msp:PORT`; empty for
    /// none. Parsed by the bridge.
    pub link: String,
    /// The vehicle's XBee, 4 or 16 hexadecimal digits; API modes only. Parsed by the bridge.
    pub xbee_address: String,
    /// Whether the serial port uses RTS and CTS.
    pub hardware_flow_control: bool,
    /// Rate at which the vehicle's status is requested \[Hz\].
    pub status_rate_hz: f64,
    /// Time without a valid reply after which the vehicle counts as silent \[ms\].
    pub silence_ms: f64,
    /// Command timeout \[control periods\]: a command published longer ago is not sent; a zero set-point is sent instead.
    pub command_timeout_periods: f64,
    /// Time without a set-point after which the vehicle acts by itself, for a protocol that does not report it \[ms\]; 0 if unknown.
    pub vehicle_time_out_ms: f64,
    /// Time after which starting or stopping the motors is abandoned \[ms\].
    pub motor_sequence_ms: f64,
    /// Time for which the daemon must command "disarmed" before the motors are stopped \[ms\].
    pub rest_ms: f64,
    /// Whether the vehicle's emergency stop is sent if its motors cannot be stopped otherwise.
    pub emergency_stop: bool,
    /// Known part of the time from a command's last byte on the wire to its effect \[ms\].
    pub air_latency_ms: f64,
    /// `[bridge.asctec]`: meaning of counts.
    pub asctec: AsctecOptions,
    /// `[bridge.crtp]`: settings for a Crazyflie.
    pub crtp: CrtpOptions,
    /// `[bridge.mavlink]`: settings for MAVLink.
    pub mavlink: MavlinkOptions,
    /// `[bridge.msp]`: settings for Betaflight.
    pub msp: MspOptions,
}

impl BridgeOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        self.crtp.check().map_err(|error| error.within("bridge.crtp"))?;
        check_options([
            ("status-rate-hz", self.status_rate_hz, Rule::Positive),
            ("silence-ms", self.silence_ms, Rule::Positive),
            ("command-timeout-periods", self.command_timeout_periods, COMMAND_TIMEOUT_PERIODS),
            ("vehicle-time-out-ms", self.vehicle_time_out_ms, Rule::NotNegative),
            ("motor-sequence-ms", self.motor_sequence_ms, Rule::Positive),
            ("rest-ms", self.rest_ms, Rule::Positive),
            ("air-latency-ms", self.air_latency_ms, Rule::NotNegative),
        ])
        .and_then(|()| self.mavlink.check())
        .map_err(|error| error.within("bridge"))
    }
}
