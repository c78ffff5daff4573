//! The processes of an instance, as far as they are heard.

use oqtal_bus::message::{Header, HealthV1};
use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;
use oqtal_runtime::health::SILENCE;

/// Processes that are observed.
pub const OBSERVED: [Role; 5] =
    [Role::Daemon, Role::Plant, Role::Bridge, Role::Mocap, Role::Receiver];

/// What was heard last of a process.
#[derive(Clone, Copy, Debug)]
pub struct HeardProcess {
    /// The process.
    pub role: Role,
    /// Its process id \[-\].
    pub pid: u32,
    /// Its health.
    pub health: HealthV1,
    /// Whether it counts as silent.
    pub is_silent: bool,
}

/// A process that came, or fell silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessChange {
    /// It is heard, for the first time or again, with this process id.
    Came(Role, u32),
    /// It is not heard any more.
    Silent(Role),
}

/// The processes that were heard.
#[derive(Debug, Default)]
pub struct ProcessTable(Vec<HeardProcess>);

impl ProcessTable {
    /// Takes a health message that is fresh at `now`.
    pub fn hear(
        &mut self,
        now: Time,
        role: Role,
        said: (&Header, &HealthV1),
    ) -> Option<ProcessChange> {
        let (header, health) = said;
        if is_old(health, now) {
            return None;
        }
        let pid = header.origin().process();
        let heard = HeardProcess { role, pid, health: *health, is_silent: false };
        let known = self.0.iter_mut().find(|process| process.role == role);
        let is_new = known.as_ref().is_none_or(|known| known.is_silent || known.pid != pid);
        match known {
            Some(known) => *known = heard,
            None => {
                self.0.push(heard);
                self.0.sort_by_key(|process| OBSERVED.iter().position(|r| *r == process.role));
            }
        }
        is_new.then_some(ProcessChange::Came(role, pid))
    }

    /// Finds processes that have fallen silent at `now`.
    pub fn advance(&mut self, now: Time) -> Vec<ProcessChange> {
        let fallen = self.0.iter_mut().filter(|p| !p.is_silent && is_old(&p.health, now));
        let changes = fallen.map(|process| {
            process.is_silent = true;
            ProcessChange::Silent(process.role)
        });
        changes.collect()
    }

    /// The processes, in the order of [`OBSERVED`].
    pub fn iter(&self) -> impl Iterator<Item = &HeardProcess> {
        self.0.iter()
    }

    /// Whether any process is heard.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.0.iter().any(|process| !process.is_silent)
    }

    /// Whether processes that are heard run with different configurations.
    #[must_use]
    pub fn configs_differ(&self) -> bool {
        let heard = self.0.iter().filter(|process| !process.is_silent);
        let mut hashes = heard.filter_map(|process| process.health.compared_config());
        let first = hashes.next();
        hashes.any(|hash| Some(hash) != first)
    }
}

fn is_old(health: &HealthV1, now: Time) -> bool {
    now.since(health.time) > SILENCE
}
