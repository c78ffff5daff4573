//! `[bridge]`: the way to a real vehicle.

use oqtal_wire::asctec::Scales;
use oqtal_wire::link::LinkSpec;
use oqtal_wire::xbee::Address;
use serde::{Deserialize, Serialize};

use crate::{Violation, link_at, not_negative, positive};

/// Command timeouts allowed \[control periods\]: below, no command arrives in time; above, the vehicle flies on too long.
const COMMAND_TIMEOUT_PERIODS: std::ops::RangeInclusive<f64> = 1.5..=15.0;

/// `[bridge]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Bridge {
    /// Where the vehicle is, `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`; empty for nowhere.
    pub link: String,
    /// The vehicle's XBee, 4 or 16 hexadecimal digits; API modes only.
    pub xbee_address: String,
    /// Whether RTS and CTS hold the other end back.
    pub hardware_flow_control: bool,
    /// Rate at which the vehicle's status is requested \[Hz\].
    pub status_rate_hz: f64,
    /// A vehicle that says nothing valid for so long is silent \[ms\].
    pub silence_ms: f64,
    /// Command timeout \[control periods\]: a command published longer ago is not sent; a zero set-point is sent instead.
    pub command_timeout_periods: f64,
    /// The sequence that starts or stops the motors is given up after so long \[ms\].
    pub motor_sequence_ms: f64,
    /// Time for which the daemon must command "disarmed" before the motors are stopped \[ms\].
    pub rest_ms: f64,
    /// Whether the vehicle's emergency stop is sent when its motors cannot be stopped otherwise.
    pub emergency_stop: bool,
    /// From a command's last byte on the wire to its effect, as far as it is known \[ms\].
    pub air_latency_ms: f64,
    /// `[bridge.asctec]`: what counts mean, for both ends of the wire.
    pub asctec: Scales,
}

impl Bridge {
    /// The link that is named; `None` if none is.
    ///
    /// # Errors
    /// The text is no link.
    pub fn link(&self) -> Result<Option<LinkSpec>, Violation> {
        link_at("bridge.link", &self.link)
    }

    /// The vehicle's XBee.
    ///
    /// # Errors
    /// The text is no address.
    pub fn xbee_address(&self) -> Result<Address, Violation> {
        let text = &self.xbee_address;
        let address = match text.len() {
            4 => u16::from_str_radix(text, 16).ok().map(Address::Short),
            16 => u64::from_str_radix(text, 16).ok().map(Address::Long),
            _ => None,
        };
        let rule = || format!("must be 4 or 16 hexadecimal digits, is `{text}`");
        address.ok_or_else(|| Violation::new("bridge.xbee-address", rule()))
    }

    pub(crate) fn check(&self) -> Result<(), Violation> {
        self.link()?;
        self.xbee_address()?;
        positive("bridge.status-rate-hz", self.status_rate_hz)?;
        positive("bridge.silence-ms", self.silence_ms)?;
        if !COMMAND_TIMEOUT_PERIODS.contains(&self.command_timeout_periods) {
            let (least, most) = (COMMAND_TIMEOUT_PERIODS.start(), COMMAND_TIMEOUT_PERIODS.end());
            let rule =
                format!("must lie between {least} and {most}, is {}", self.command_timeout_periods);
            return Err(Violation::new("bridge.command-timeout-periods", rule));
        }
        positive("bridge.motor-sequence-ms", self.motor_sequence_ms)?;
        positive("bridge.rest-ms", self.rest_ms)?;
        not_negative("bridge.air-latency-ms", self.air_latency_ms)?;
        let invalid = |error: oqtal_wire::asctec::InvalidScale| {
            Violation::new(format!("bridge.asctec.{}", error.key), error.rule)
        };
        self.asctec.check().map_err(invalid)
    }
}
