//! Arbitrary bytes as tables.

use std::path::Path;

use oqtal_control::trajectory::Waypoints;
use oqtal_mocap_emu::Recording;

/// Reads a recording of cameras.
pub fn any_poses(bytes: &[u8]) {
    if let Ok(poses) = Recording::parse(Path::new("p.csv"), bytes) {
        let _ = poses.timing();
    }
}

/// Reads waypoints.
pub fn any_waypoints(bytes: &[u8]) {
    let _ = Waypoints::parse(&String::from_utf8_lossy(bytes));
}
