//! The configuration of a running daemon.

use oqtal_bus::paths::InstancePaths;
use oqtal_config::Config;

/// The configuration with which the daemon of an instance was started, as it wrote it; `None` before one was, and while it writes.
pub fn daemon_config(place: &InstancePaths) -> Option<Config> {
    text_and_config(place).map(|(_, config)| config)
}

/// Like [`daemon_config`], with the text of the file.
pub fn text_and_config(place: &InstancePaths) -> Option<(String, Config)> {
    let file = place.config();
    let text = std::fs::read_to_string(&file).ok()?;
    let config = Config::parse(&file.to_string_lossy(), &text, &[]).ok()?;
    Some((text, config))
}
