//! Configuration of the last daemon of an instance: the file `config.toml` in its directory, with its comments.

use std::path::{Path, PathBuf};

use oqtal_config::{Config, edited_sources};

/// Hash of the configuration in `file`, as in the health of processes; `None` if it cannot be read or is invalid.
pub fn hash_of_file(file: &Path) -> Option<String> {
    read_config(file).map(|config| format!("{:016x}", config.hash()))
}

/// Whether a daemon with the configuration in `file` takes off without an operator; false if it cannot be read.
pub fn arms_at_start(file: &Path) -> bool {
    read_config(file).is_some_and(|config| config.safety.arm_at_start)
}

fn read_config(file: &Path) -> Option<Config> {
    let text = std::fs::read_to_string(file).ok()?;
    Config::parse(&file.to_string_lossy(), &text, &[]).ok()
}

/// Files that were edited or removed, by the comments in `file`, the configuration of a daemon: after its start, or, with `since_reload`,
/// after it last read them; none if `file` cannot be read.
pub fn edited_files(file: &Path, since_reload: bool) -> Vec<PathBuf> {
    edited_sources(&text_of(file), since_reload)
}

/// The waypoint file that was edited or removed after the daemon with the configuration in `file` had read it; `None` if none was.
pub fn edited_waypoints(file: &Path) -> Option<PathBuf> {
    oqtal_config::edited_waypoints(&text_of(file))
}

/// Whether the daemon with the configuration in `file` was started from a copy of an earlier configuration; false if it cannot be read.
pub fn is_copy(file: &Path) -> bool {
    oqtal_config::is_copy(&text_of(file))
}

/// Whether the configuration in `file` belongs to `oqtal chain run`; false if it cannot be read.
pub fn is_of_chain(file: &Path) -> bool {
    oqtal_config::is_of_chain(&text_of(file))
}

/// Whether the vehicle of the daemon with the configuration in `file` is behind a bridge; false if it is not known to be.
pub fn has_bridge(file: &Path) -> bool {
    let is_named = |config: Config| !config.bridge.link.is_empty();
    is_of_chain(file) || read_config(file).is_some_and(is_named)
}

/// Command of the flight to which the configuration in `file` belongs; `None` for a daemon that was started on its own, or if the file
/// cannot be read.
pub fn flight_of(file: &Path) -> Option<String> {
    oqtal_config::flight_of(&text_of(file)).map(str::to_owned)
}

/// Text of a configuration with its comments; empty if it cannot be read.
fn text_of(file: &Path) -> String {
    std::fs::read_to_string(file).unwrap_or_default()
}
