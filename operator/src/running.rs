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
    /// Hash of their configuration; `None` if it is unknown, or if they differ.
    config: Option<String>,
    /// State of the vehicle; `None` if it was not published.
    pub(crate) vehicle: Option<VehicleStatus>,
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
    /// Observes the processes of the instance at `paths`; none if nobody runs, on an error, or without a result in time.
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
                    let config = status.common_config().map(str::to_owned);
                    let _ = sender.send(Self { config, vehicle: status.vehicle, ..found });
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

    /// Process whose configuration a daemon needs, if that in `config.toml` of the instance at `paths`, of the last daemon, is another.
    pub(crate) fn of_other_config(&self, paths: &InstancePaths) -> Option<&str> {
        let is_same = *self.config.as_ref()? == hash_of_file(&paths.config())?;
        self.names.first().filter(|_| !is_same).map(|(_, name)| name.as_str())
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
}
