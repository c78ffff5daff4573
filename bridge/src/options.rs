//! `[bridge]` in the terms of `oqtal-wire`: link, address, scales.

use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::asctec::{InvalidScale, Scales, StickMeaning};
use oqtal_wire::link::{InvalidLink, LinkSpec};
use oqtal_wire::mavlink::{SigningKey, ThrustCurve};
use oqtal_wire::xbee::Address;

/// Checks link, address and scales, whether or not a bridge is used.
///
/// # Errors
/// The first value that cannot be used.
pub fn check(config: &Config) -> Result<(), OptionError> {
    address(config)?;
    scales(config)?;
    thrust_curve(config)?;
    signing_key(config)?;
    link(config).map(drop)
}

/// The link to the vehicle; `None` if none is configured.
///
/// # Errors
/// `bridge.link` is no link.
pub fn link(config: &Config) -> Result<Option<LinkSpec>, OptionError> {
    let text = &config.bridge.link;
    if text.is_empty() {
        return Ok(None);
    }
    let refused = |error: InvalidLink| {
        OptionError::new("bridge.link", format!("`{text}`"), format!("a link: {error}"))
    };
    text.parse().map(Some).map_err(refused)
}

/// The vehicle's XBee.
///
/// # Errors
/// `bridge.xbee-address` is no address.
pub fn address(config: &Config) -> Result<Address, OptionError> {
    let text = &config.bridge.xbee_address;
    let form = "4 or 16 hexadecimal digits";
    text.parse().map_err(|_| OptionError::new("bridge.xbee-address", format!("`{text}`"), form))
}

/// What counts mean to the vehicle.
///
/// # Errors
/// A scale of `[bridge.asctec]` cannot be used.
pub fn scales(config: &Config) -> Result<Scales, OptionError> {
    let mut scales: Scales = config.bridge.asctec.convert("bridge.asctec")?;
    if config.vehicle.interface.holds_attitude() {
        scales.sticks = StickMeaning::Attitude;
    }
    let checked = scales.check();
    let refused = |error: InvalidScale| {
        OptionError::new(format!("bridge.asctec.{}", error.key), "unusable", error.rule)
    };
    checked.map(|()| scales).map_err(refused)
}

/// What the thrust of a MAVLink set-point means.
///
/// # Errors
/// `bridge.mavlink.thrust-table` is no thrust curve.
pub fn thrust_curve(config: &Config) -> Result<ThrustCurve, OptionError> {
    let curve = ThrustCurve::new(&config.bridge.mavlink.thrust_table);
    let key = "bridge.mavlink.thrust-table";
    curve.map_err(|error| OptionError::new(key, "unusable", error.to_string()))
}

/// The key by which MAVLink packets are signed; `None` for packets without a signature.
///
/// # Errors
/// `bridge.mavlink.signing-key` is no key.
pub fn signing_key(config: &Config) -> Result<Option<SigningKey>, OptionError> {
    let text = &config.bridge.mavlink.signing_key;
    if text.is_empty() {
        return Ok(None);
    }
    // The key is a secret: it is not part of the message.
    let key = "bridge.mavlink.signing-key";
    let wrong = || OptionError::new(key, "unusable", "64 hexadecimal digits");
    SigningKey::from_hex(text).map(Some).ok_or_else(wrong)
}
