//! `[bridge]` in the terms of `oqtal-wire`: link, address, scales.

use std::path::Path;

use oqtal_config::{Config, parse_option};
use oqtal_control::options::OptionError;
use oqtal_runtime::files;
use oqtal_wire::asctec::{InvalidScale, Scales, StickMeaning};
use oqtal_wire::link::LinkSpec;
use oqtal_wire::mavlink::SigningKey;
use oqtal_wire::xbee::Address;
use oqtal_wire::{InvalidThrustCurve, ThrustCurve};

/// Checks link, address and scales, whether or not a bridge is used.
///
/// # Errors
/// The first value that cannot be used.
pub fn check(config: &Config) -> Result<(), OptionError> {
    address(config)?;
    scales(config)?;
    thrust_curve("mavlink", &config.bridge.mavlink.thrust_table)?;
    thrust_curve("msp", &config.bridge.msp.thrust_table)?;
    link(config).map(drop)
}

/// The link to the vehicle; `None` if none is configured.
///
/// # Errors
/// `bridge.link` is not a link.
pub fn link(config: &Config) -> Result<Option<LinkSpec>, OptionError> {
    parse_option("bridge.link", &config.bridge.link, "a link")
}

/// The vehicle's XBee.
///
/// # Errors
/// `bridge.xbee-address` is not an address.
pub fn address(config: &Config) -> Result<Address, OptionError> {
    let text = &config.bridge.xbee_address;
    let form = "4 or 16 hexadecimal digits";
    text.parse().map_err(|_| OptionError::new("bridge.xbee-address", format!("`{text}`"), form))
}

/// Scales of the vehicle's counts.
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

/// Curve of the thrust of a set-point, `points` of `bridge.PROTOCOL.thrust-table`.
///
/// # Errors
/// The points are not a thrust curve.
pub fn thrust_curve(protocol: &str, points: &[[f64; 2]]) -> Result<ThrustCurve, OptionError> {
    let key = || format!("bridge.{protocol}.thrust-table");
    let refused =
        |error: InvalidThrustCurve| OptionError::new(key(), "unusable", error.to_string());
    ThrustCurve::new(points).map_err(refused)
}

/// The key by which MAVLink packets are signed, from its file; `None` for packets without a signature.
///
/// # Errors
/// `bridge.mavlink.signing-key-file` is not a file for this user alone, or contains no key.
pub fn signing_key(config: &Config) -> Result<Option<SigningKey>, OptionError> {
    let path = &config.bridge.mavlink.signing_key_file;
    if path.is_empty() {
        return Ok(None);
    }
    let refused = |rule: String| {
        OptionError::new("bridge.mavlink.signing-key-file", format!("`{path}`"), rule)
    };
    let text = files::read_secret(Path::new(path))
        .map_err(|error| refused(format!("a file for its owner alone: {error}")))?;
    // The key is a secret: it is not part of the message.
    let wrong = || refused("a file with 64 hexadecimal digits".to_owned());
    SigningKey::from_hex(text.trim()).map(Some).ok_or_else(wrong)
}

/// Text by which a bridge and a chain compare their keys: a fingerprint of [`signing_key`]. A key that cannot be read counts as none: the
/// protocol that signs packets reports it.
pub fn key_fingerprint(config: &Config) -> String {
    let key = signing_key(config).ok().flatten();
    key.map_or("no key".to_owned(), |key| key.fingerprint())
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt;

    use oqtal_config::Setting;

    use super::*;

    #[test]
    fn a_key_is_read_from_a_private_file_and_appears_in_no_message() {
        let path = std::env::temp_dir().join(format!("oqtal-key-{}", std::process::id()));
        let shown = path.display().to_string();
        let key = || {
            let key = "bridge.mavlink.signing-key-file";
            let settings = [Setting::flag("test", key, shown.as_str())];
            let config = Config::from_settings(&settings).unwrap();
            assert!(!config.to_toml().contains("abab"));
            signing_key(&config).map_err(|error| error.to_string())
        };
        assert!(key().unwrap_err().contains("No such file"));
        fs::write(&path, "ab".repeat(32) + "\n").unwrap();
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        assert!(key().unwrap_err().contains("chmod 600"));
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        assert_eq!(key().unwrap(), SigningKey::from_hex(&"ab".repeat(32)));
        fs::write(&path, "abab").unwrap();
        let message = key().unwrap_err();
        assert!(message.contains("64 hexadecimal digits") && !message.contains("abab"));
        fs::remove_file(&path).unwrap();
        assert_eq!(signing_key(&Config::default()).unwrap(), None);
    }
}
