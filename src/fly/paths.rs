//! Paths of a flight's messages to the vehicle and from the cameras.

use oqtal_bus::topic::Role;
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure};

use super::cameras::PosePath;
use super::vehicle::CommandLink;

/// Path of the commands to the vehicle, and of the poses to the daemon.
#[derive(Clone, Debug, Default)]
pub struct FlightPaths {
    /// Path of the commands.
    pub commands: CommandLink,
    /// Path of the poses.
    pub poses: PosePath,
    /// Whether receiver and daemon are one process, `oqtal chain`.
    pub is_chain: bool,
}

impl FlightPaths {
    /// Checks that a chain has cameras and a bridge.
    ///
    /// # Errors
    /// One of both is missing (exit code 64).
    pub fn check(&self) -> Result<(), Failure> {
        if self.is_chain && (self.poses == PosePath::Bus || self.commands == CommandLink::Bus) {
            let message = "--chain needs cameras over a network and a vehicle behind a bridge: add --mocap and --vehicle, as in --mocap qtm --vehicle bridge:mavlink";
            return Err(Failure::new(Exit::Usage, message));
        }
        Ok(())
    }

    /// Processes of a flight under `config`, in start order.
    pub fn roles(&self, config: &Config) -> Vec<Role> {
        let mut roles = self.poses.roles(self.commands.roles(config));
        roles.retain(|role| !(self.is_chain && *role == Role::Receiver));
        roles
    }
}
