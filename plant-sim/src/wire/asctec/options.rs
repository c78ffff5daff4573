//! `[plant.wire]` as types of `oqtal-wire`: address and scales of an AscTec vehicle.

use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::asctec::{InvalidScale, Scales, StickMeaning};
use oqtal_wire::xbee::Address;

/// Checks `[plant.wire]`.
///
/// # Errors
/// Address or scales are invalid.
pub(in crate::wire) fn check(config: &Config) -> Result<(), OptionError> {
    address(config)?;
    scales(config).map(drop)
}

/// Address of the host's XBee.
pub(super) fn address(config: &Config) -> Result<Address, OptionError> {
    let text = &config.plant.wire.xbee_address;
    let form = "4 or 16 hexadecimal digits";
    text.parse().map_err(|_| OptionError::new("plant.wire.xbee-address", format!("`{text}`"), form))
}

/// Scales of sticks and measurements \[counts\].
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
