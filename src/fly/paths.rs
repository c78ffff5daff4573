//! Paths of a flight's messages to the vehicle and from the cameras.

use super::cameras::PosePath;
use super::vehicle::CommandLink;

/// Path of the commands to the vehicle, and of the poses to the daemon.
#[derive(Clone, Debug, Default)]
pub struct FlightPaths {
    /// Path of the commands.
    pub commands: CommandLink,
    /// Path of the poses.
    pub poses: PosePath,
}
