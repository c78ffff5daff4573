//! The processes of a flight.

use std::fs::{self, Metadata};
use std::path::Path;
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure};

use oqtal_lab::mission::Mission;

use super::vehicle::VehicleLink;
use crate::child::{Child, command};

/// A process has so long to come up.
pub const PATIENCE: Span = Span::from_millis(10_000);

/// The processes of a flight. None outlives it: they end when it is dropped, and when this process dies.
#[derive(Debug)]
pub struct ProcessGroup {
    members: Vec<(Role, Child)>,
}

impl ProcessGroup {
    /// Starts those whom `mission` takes, with the configuration file `config`; their logs go to `logs`.
    ///
    /// # Errors
    /// A process cannot be started, or ends before the next one finds what it needs of it.
    pub fn start(
        (mission, link): (&Mission, &VehicleLink),
        config: &Path,
        logs: &Path,
    ) -> Result<Self, Failure> {
        let mut processes = Self { members: Vec::new() };
        let roles = link.roles(&mission.config).iter();
        for &role in roles.filter(|&&role| role != Role::Recorder) {
            if let (Role::Bridge, Some(path)) = (role, link.awaited()) {
                processes.wait_for(path, config)?;
            }
            let member = Child::start(role.name(), command(&[role.name()], config)?, logs)?;
            processes.members.push((role, member));
        }
        Ok(processes)
    }

    /// Waits until `link` was made, later than the file `config`: one that a killed plant left may lead anywhere by now.
    fn wait_for(&mut self, link: &Path, config: &Path) -> Result<(), Failure> {
        let give_up = Time::now() + PATIENCE;
        let made = |file: std::io::Result<Metadata>| file.and_then(|file| file.modified()).ok();
        let begun = made(fs::metadata(config));
        while made(fs::symlink_metadata(link)).is_none_or(|at| Some(at) < begun) {
            if let Some(failure) = self.fallen() {
                return Err(failure);
            }
            if Time::now() >= give_up {
                let message = format!("plant-sim never made {}; see its log", link.display());
                return Err(Failure::new(Exit::Peer, message));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// A failure if one of them has ended.
    pub fn fallen(&mut self) -> Option<Failure> {
        self.members.iter_mut().find_map(|(_, member)| member.fallen())
    }

    /// Asks all to end, the daemon first so that it disarms the vehicle, then the bridge, which sends zero set-points; waits for each.
    pub fn dismiss(&mut self) {
        for leaving in [Role::Daemon, Role::Bridge, Role::Mocap, Role::Plant] {
            for (_, member) in self.members.iter_mut().filter(|(role, _)| *role == leaving) {
                member.dismiss();
            }
        }
        self.members.clear();
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        self.dismiss();
    }
}
