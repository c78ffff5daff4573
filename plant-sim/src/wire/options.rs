//! `[plant.wire]` in the terms of `oqtal-wire`: link, address, scales.

use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::asctec::{InvalidScale, Scales, StickMeaning};
use oqtal_wire::link::{InvalidLink, LinkSpec};
use oqtal_wire::xbee::Address;

/// The link at which the emulated vehicle is to be found; `None` if its commands come over the bus.
///
/// # Errors
/// Link, address or scales cannot be used.
pub fn link(config: &Config) -> Result<Option<LinkSpec>, OptionError> {
    address(config)?;
    scales(config)?;
    let text = &config.plant.wire.link;
    if text.is_empty() {
        return Ok(None);
    }
    let refused = |error: InvalidLink| {
        OptionError::new("plant.wire.link", format!("`{text}`"), format!("a link: {error}"))
    };
    text.parse().map(Some).map_err(refused)
}

/// The host's XBee as the vehicle addresses it.
pub(super) fn address(config: &Config) -> Result<Address, OptionError> {
    let text = &config.plant.wire.xbee_address;
    let form = "4 or 16 hexadecimal digits";
    text.parse().map_err(|_| OptionError::new("plant.wire.xbee-address", format!("`{text}`"), form))
}

/// What counts mean to the vehicle.
pub(super) fn scales(config: &Config) -> Result<Scales, OptionError> {
    let mut scales: Scales = config.plant.wire.asctec.convert("plant.wire.asctec")?;
    if config.plant.interface.holds_attitude() {
        scales.sticks = StickMeaning::Attitude;
    }
    let checked = scales.check();
    let refused = |error: InvalidScale| {
        OptionError::new(format!("plant.wire.asctec.{}", error.key), "unusable", error.rule)
    };
    checked.map(|()| scales).map_err(refused)
}
