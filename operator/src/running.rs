//! Processes of an instance by their places on its bus, with their configuration and vehicle: also those that no stop reaches.

use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_observe::config_file::hash_of_file;
use oqtal_observe::status::VehicleStatus;
use oqtal_runtime::program::beside;

use crate::status;

/// Time after which an observation is abandoned: a suspended process may hold the lock of the instance.
const TIMEOUT: Span = Span::from_millis(2000);

/// Running processes of one instance.
#[derive(Clone, Debug, Default)]
pub(crate) struct RunningProcesses {
    /// Name and id of each, as in "`oqtal mocap-emu` (123)".
    names: Vec<(Role, String)>,
    /// Hashes of the configurations of those that are known, in the same order.
    configs: Vec<(Role, String)>,
    /// State of the vehicle; `None` if it was not published.
    pub(crate) vehicle: Option<VehicleStatus>,
}

/// A running process with another configuration than the last daemon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OtherConfig<'a> {
    /// Name and id.
    pub(crate) process: &'a str,
    /// Whether all processes have its configuration.
    pub(crate) is_common: bool,
}

/// Observation of running processes on a separate thread, which may be abandoned: receives their names first, then also the
/// configuration and the vehicle.
#[derive(Debug)]
pub(crate) struct RunningObservation(Receiver<RunningProcesses>);

impl RunningObservation {
    /// The newest result; the observation ends or is abandoned at `give_up`.
    pub(crate) fn newest(&self, give_up: Time) -> RunningProcesses {
        let next = || self.0.recv_timeout(left(give_up)).ok();
        std::iter::from_fn(next).last().unwrap_or_default()
    }
}

impl RunningProcesses {
    /// Observes the processes of the instance at `paths`; none if no process runs, on an error, or without a result in time.
    pub(crate) fn observe(paths: &InstancePaths) -> Self {
        Self::beside(paths).newest(Time::now() + TIMEOUT)
    }

    /// Begins an observation on a separate thread.
    pub(crate) fn beside(paths: &InstancePaths) -> RunningObservation {
        let (sender, receiver) = channel();
        let paths = paths.clone();
        beside(move || {
            let look = || -> Result<(), BusError> {
                let Some(bus) = Bus::open_running(&paths)? else { return Ok(()) };
                let mut found = Self::default();
                for role in Role::PROCESSES {
                    found.names.extend(bus.holder(&role.health())?.map(|name| (role, name)));
                }
                // Fails once the receiver has been dropped.
                let _ = sender.send(found.clone());
                if !found.names.is_empty() {
                    let status = status::observe(&bus)?;
                    let config = |(role, _): &(Role, String)| {
                        status.config_of(*role).map(|hash| (*role, hash.to_owned()))
                    };
                    let configs = found.names.iter().filter_map(config).collect();
                    let _ = sender.send(Self { configs, vehicle: status.vehicle, ..found });
                }
                Ok(())
            };
            // Without an answer nothing is known of the processes.
            let _ = look();
        });
        RunningObservation(receiver)
    }

    /// Their names; `None` if none runs.
    pub(crate) fn listed(&self) -> Option<String> {
        let names: Vec<_> = self.names.iter().map(|(_, name)| name.as_str()).collect();
        (!names.is_empty()).then(|| names.join(", "))
    }

    /// Whether a bridge or a daemon is among them.
    pub(crate) fn may_control(&self) -> bool {
        self.names.iter().any(|(role, _)| matches!(role, Role::Bridge | Role::Daemon))
    }

    /// Whether the process of a simulated vehicle is among them.
    pub(crate) fn has_simulator(&self) -> bool {
        self.names.iter().any(|(role, _)| *role == Role::Plant)
    }

    /// A process with another configuration than that in `config.toml` of the instance at `paths`, of the last daemon.
    pub(crate) fn of_other_config(&self, paths: &InstancePaths) -> Option<OtherConfig<'_>> {
        let last = hash_of_file(&paths.config())?;
        let (role, other) = self.configs.iter().find(|(_, hash)| *hash != last)?;
        let (_, process) = self.names.iter().find(|(named, _)| named == role)?;
        let is_common = self.configs.iter().all(|(_, hash)| hash == other);
        Some(OtherConfig { process, is_common })
    }
}

/// Time left until `give_up`.
pub(crate) fn left(give_up: Time) -> Duration {
    give_up.since(Time::now()).to_duration()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_observation_that_hangs_is_abandoned_with_its_newest_result() {
        let (sender, receiver) = channel();
        let hangs = RunningObservation(receiver);
        let named = |name: &str| RunningProcesses {
            names: vec![(Role::Plant, name.to_owned())],
            ..RunningProcesses::default()
        };
        ["a", "b"].into_iter().for_each(|name| sender.send(named(name)).unwrap());
        assert_eq!(hangs.newest(Time::now()).listed().as_deref(), Some("b"));
        assert_eq!(hangs.newest(Time::now()).listed(), None);
        drop(sender);
    }

    #[test]
    fn a_process_with_another_configuration_than_the_last_daemon_is_found_also_beside_one_with_the_same()
     {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        std::fs::create_dir_all(paths.directory()).unwrap();
        std::fs::write(paths.config(), "[vehicle]\nmass-kg = 0.52\n").unwrap();
        let last = hash_of_file(&paths.config()).unwrap();
        let other = |plant: &str, mocap: &str| {
            let both = [Role::Plant, Role::Mocap];
            let running = RunningProcesses {
                names: both.map(|role| (role, role.name().to_owned())).to_vec(),
                configs: both.into_iter().zip([plant.to_owned(), mocap.to_owned()]).collect(),
                vehicle: None,
            };
            running.of_other_config(&paths).map(|it| (it.process.to_owned(), it.is_common))
        };
        assert_eq!(other(&last, &last), None);
        assert_eq!(other("x", "x"), Some(("plant-sim".to_owned(), true)));
        assert_eq!(other(&last, "x"), Some(("mocap-emu".to_owned(), false)));
    }
}
