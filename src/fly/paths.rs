//! The paths of a flight's messages between its processes and vehicle and cameras.

use super::cameras::PosePath;
use super::vehicle::CommandLink;

/// How commands reach the vehicle, and poses the daemon.
#[derive(Clone, Debug, Default)]
pub struct FlightPaths {
    /// The path of the commands.
    pub commands: CommandLink,
    /// The path of the poses.
    pub poses: PosePath,
}
