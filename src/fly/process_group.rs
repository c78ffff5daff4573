//! The processes of one flight: started together, ended together.

use std::fs::{self, Metadata};
use std::path::Path;
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure};

use oqtal_lab::mission::Mission;
use oqtal_receiver::connect_to_all;
use oqtal_receiver::link::CameraLink;

use super::directory::FlightDirectory;
use super::processes::FlightPaths;
use crate::child::{Child, command};

/// Start-up time-out: a process that is not ready after this time counts as failed.
pub const START_TIMEOUT: Span = Span::from_millis(10_000);

/// The processes of a flight. They end when the group is dropped, and when this process dies.
#[derive(Debug)]
pub struct ProcessGroup {
    members: Vec<(Role, Child)>,
}

impl ProcessGroup {
    /// Starts the processes that `mission` needs, with the configuration file in `directory`, where their logs go too.
    ///
    /// # Errors
    /// A process cannot be started, or ends before the link that the next one opens exists.
    pub fn start(
        (mission, paths): (&Mission, &FlightPaths),
        directory: &FlightDirectory,
    ) -> Result<Self, Failure> {
        let (config, logs) = (&directory.config(), directory.path());
        let mut processes = Self { members: Vec::new() };
        let FlightPaths { commands, poses } = paths;
        let roles = poses.roles(commands.roles(&mission.config));
        for role in roles.into_iter().filter(|role| *role != Role::Recorder) {
            match (role, commands.awaited(), poses.awaited()) {
                (Role::Bridge, Some(path), _) => processes.wait_for(path, config)?,
                (Role::Receiver, _, Some(link)) => processes.wait_for_cameras(link)?,
                _ => {}
            }
            let member = Child::start(role.name(), command(&[role.name()], config)?, logs)?;
            processes.members.push((role, member));
        }
        Ok(processes)
    }

    /// Waits until the plant has created `link`. A link that is older than the file `config` was left behind by a killed plant.
    fn wait_for(&mut self, link: &Path, config: &Path) -> Result<(), Failure> {
        let deadline = Time::now() + START_TIMEOUT;
        let made = |file: std::io::Result<Metadata>| file.and_then(|file| file.modified()).ok();
        let begun = made(fs::metadata(config));
        while made(fs::symlink_metadata(link)).is_none_or(|at| Some(at) < begun) {
            if let Some(failure) = self.failure() {
                return Err(failure);
            }
            if Time::now() >= deadline {
                let message = format!(
                    "plant-sim did not create {}; see plant-sim.log beside the report",
                    link.display()
                );
                return Err(Failure::new(Exit::Peer, message));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// Waits until emulated cameras serve their body.
    fn wait_for_cameras(&mut self, link: &CameraLink) -> Result<(), Failure> {
        let deadline = Time::now() + START_TIMEOUT;
        while let Err(error) = connect_to_all(link) {
            if let Some(failure) = self.failure() {
                return Err(failure);
            }
            if Time::now() >= deadline {
                let message = format!("{error}; see mocap-emu.log beside the report");
                return Err(Failure::new(Exit::Peer, message));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// The failure of the first process found to have ended; `None` while all run.
    pub fn failure(&mut self) -> Option<Failure> {
        self.members.iter_mut().find_map(|(_, member)| member.failure())
    }

    /// Ends all processes and waits for each: the daemon first, which disarms the vehicle, then the bridge, which transmits that.
    pub fn shut_down(&mut self) {
        for leaving in [Role::Daemon, Role::Bridge, Role::Receiver, Role::Mocap, Role::Plant] {
            for (_, member) in self.members.iter_mut().filter(|(role, _)| *role == leaving) {
                member.shut_down();
            }
        }
        self.members.clear();
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        self.shut_down();
    }
}
