//! The processes of one flight: started together, ended together.

use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure, instance_paths};

use oqtal_lab::mission::Mission;
use oqtal_receiver::connect_to_all;
use oqtal_wire::link::CameraLink;
use rustix::process::Signal;

use super::directory::FlightDirectory;
use super::fault::ProcessAction;
use super::paths::FlightPaths;
use super::progress::Interrupts;
use crate::child::{Child, command};

/// Start-up time-out: a process that is not ready after this time counts as failed.
pub const START_TIMEOUT: Span = Span::from_millis(10_000);

/// The processes of a flight. They end when the group is dropped, and when this process dies.
#[derive(Debug)]
pub struct ProcessGroup {
    members: Vec<Member>,
    config: PathBuf,
}

/// A process of the group.
#[derive(Debug)]
struct Member {
    role: Role,
    /// Name of the command that runs it.
    name: &'static str,
    child: Child,
    /// Whether a fault killed the process and it is to be restarted: its end is not a failure.
    is_down: bool,
}

impl ProcessGroup {
    /// Starts the processes of `mission` with the configuration file in `directory`, which also contains their logs.
    ///
    /// # Errors
    /// A process cannot be started, or ends before creating the link that the next one opens; or the operator interrupts.
    pub fn start(
        (mission, paths): (&Mission, &FlightPaths),
        directory: &FlightDirectory,
        interrupts: &Interrupts,
    ) -> Result<Self, Failure> {
        let mut processes = Self { members: Vec::new(), config: directory.config() };
        let FlightPaths { commands, poses, is_chain } = paths;
        let roles = paths.roles(&mission.config);
        for role in roles.into_iter().filter(|role| *role != Role::Recorder) {
            let is_chain = *is_chain && role == Role::Daemon;
            match (role, commands.awaited(), poses.awaited()) {
                (Role::Bridge, Some(path), _) => {
                    processes.wait_for(path, Role::Plant, interrupts)?
                }
                (_, _, Some(link)) if is_chain || role == Role::Receiver => {
                    processes.wait_for_cameras(link, interrupts)?;
                }
                _ => {}
            }
            if is_chain {
                let socket = instance_paths(&mission.config)?.chain();
                processes.wait_for(&socket, Role::Bridge, interrupts)?;
            }
            interrupts.check()?;
            let name = if is_chain { "chain" } else { role.name() };
            let command = command(&[name], &processes.config)?;
            let child = Child::start(name, command, directory.path())?;
            processes.members.push(Member { role, name, child, is_down: false });
        }
        Ok(processes)
    }

    /// Applies the action of a fault to a process.
    ///
    /// # Errors
    /// The process cannot be restarted.
    pub fn apply(&mut self, role: Role, action: ProcessAction) -> Result<(), Failure> {
        let Some(member) = self.members.iter_mut().find(|member| member.role == role) else {
            return Ok(());
        };
        match action {
            ProcessAction::Kill { is_restarted } => {
                member.is_down = is_restarted;
                member.child.signal(Signal::KILL);
            }
            ProcessAction::Stop => member.child.signal(Signal::STOP),
            ProcessAction::Continue => member.child.signal(Signal::CONT),
            ProcessAction::Start => {
                member.child.restart(command(&[member.name], &self.config)?)?;
                member.is_down = false;
            }
        }
        Ok(())
    }

    /// Waits until the process `maker` has created `link`. A link older than the configuration file was left by a killed process.
    fn wait_for(
        &mut self,
        link: &Path,
        maker: Role,
        interrupts: &Interrupts,
    ) -> Result<(), Failure> {
        let deadline = Time::now() + START_TIMEOUT;
        let made = |file: std::io::Result<Metadata>| file.and_then(|file| file.modified()).ok();
        let begun = made(fs::metadata(&self.config));
        while made(fs::symlink_metadata(link)).is_none_or(|at| Some(at) < begun) {
            interrupts.check()?;
            if let Some(failure) = self.failure() {
                return Err(failure);
            }
            if Time::now() >= deadline {
                let (maker, link) = (maker.name(), link.display());
                let message =
                    format!("{maker} did not create {link}; see {maker}.log beside the report");
                return Err(Failure::new(Exit::Peer, message));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// Waits until the emulated cameras serve their body.
    fn wait_for_cameras(
        &mut self,
        link: &CameraLink,
        interrupts: &Interrupts,
    ) -> Result<(), Failure> {
        let deadline = Time::now() + START_TIMEOUT;
        while let Err(error) = connect_to_all(link) {
            interrupts.check()?;
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

    /// Failure of the first process found to have ended; `None` while all are running.
    pub fn failure(&mut self) -> Option<Failure> {
        self.camera_failure().or_else(|| self.other_failure())
    }

    /// Failure of the camera or receiver process, without which a vehicle can still descend.
    pub fn camera_failure(&mut self) -> Option<Failure> {
        self.failure_of(|role| matches!(role, Role::Mocap | Role::Receiver))
    }

    /// Failure of any other process.
    pub fn other_failure(&mut self) -> Option<Failure> {
        self.failure_of(|role| !matches!(role, Role::Mocap | Role::Receiver))
    }

    /// Whether the process of this role has ended.
    pub fn has_lost(&mut self, role: Role) -> bool {
        self.members.iter_mut().any(|it| it.role == role && it.child.failure().is_some())
    }

    fn failure_of(&mut self, is_meant: fn(Role) -> bool) -> Option<Failure> {
        let up = self.members.iter_mut().filter(|it| !it.is_down && is_meant(it.role));
        up.into_iter().find_map(|member| member.child.failure())
    }

    /// Ends all processes and waits for each: the daemon first, which disarms the vehicle, then the bridge, which transmits the
    /// command.
    pub fn shut_down(&mut self) {
        for leaving in [Role::Daemon, Role::Bridge, Role::Receiver, Role::Mocap, Role::Plant] {
            for member in self.members.iter_mut().filter(|member| member.role == leaving) {
                member.child.shut_down();
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
