//! `[bridge.crtp]` and `[plant.wire.crtp]`: a Crazyflie, at either end of its protocol.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Allowed rates of external poses \[Hz\], limited by the vehicle's estimator and the capacity of its radio.
const POSE_RATE_HZ: Rule = Rule::Between(0.0, 100.0);
/// Allowed packets per second of one vehicle: enough for poses and reports, up to the maximum of one radio.
const RADIO_PACKETS: Rule = Rule::Between(50.0, 1000.0);
/// Allowed rates of log data \[Hz\]: their period is sent as one byte in steps of 10 ms.
const LOG_RATE_HZ: Rule = Rule::Between(0.4, 100.0);

/// `[bridge.crtp]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CrtpOptions {
    /// Collective thrust over the duty cycle u, counts / 65535: the coefficients of u and of its square \[N\].
    pub thrust_curve_n: [f64; 2],
    /// Rate at which poses go to the vehicle's own estimator \[Hz\]; 0 for none.
    pub pose_rate_hz: f64,
    /// Rate at which the vehicle reports its estimate \[Hz\]; battery, supervisor and gyroscope are reported at this rate too, but at least
    /// at 50 Hz.
    pub log_rate_hz: f64,
    /// Whether the vehicle stops its motors and locks itself a second after the last packet of the bridge.
    pub keep_alive: bool,
    /// Maximum rate of packets other than set-points from a Crazyradio to the vehicle \[1/s\].
    pub radio_packets_per_s: f64,
    /// Cache file of tables of contents; `auto` for a file in the user's cache directory, empty for none.
    pub table_cache: String,
}

impl CrtpOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_curve(self.thrust_curve_n)?;
        check_options([
            ("pose-rate-hz", self.pose_rate_hz, POSE_RATE_HZ),
            ("log-rate-hz", self.log_rate_hz, LOG_RATE_HZ),
            ("radio-packets-per-s", self.radio_packets_per_s, RADIO_PACKETS),
        ])
    }
}

/// `[plant.wire.crtp]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CrtpVehicleOptions {
    /// Collective thrust over the duty cycle u, counts / 65535: the coefficients of u and of its square \[N\].
    pub thrust_curve_n: [f64; 2],
    /// Version of the vehicle's protocol \[-\].
    pub protocol: f64,
    /// Whether the vehicle arms automatically.
    pub arms_itself: bool,
}

impl CrtpVehicleOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_curve(self.thrust_curve_n)?;
        check_options([("protocol", self.protocol, Rule::Between(4.0, 255.0))])
    }
}

fn check_curve([linear, quadratic]: [f64; 2]) -> Result<(), OptionError> {
    // At full duty the curve does not fall, and the thrust is positive.
    let rises = linear >= 0.0 && linear + 2.0 * quadratic >= 0.0 && linear + quadratic > 0.0;
    let found = format!("[{linear}, {quadratic}]");
    let rule = "coefficients of a thrust that rises from zero to full duty";
    if rises { Ok(()) } else { Err(OptionError::new("thrust-curve-n", found, rule)) }
}
