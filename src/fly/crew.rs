//! The processes of a flight.

use std::path::Path;

use oqtal_bus::process::Failure;
use oqtal_bus::topic::Party;

use crate::child::{Child, command};

/// The processes of a flight. None outlives it: they end when it is dropped, and when this process dies.
#[derive(Debug)]
pub struct Crew {
    members: Vec<(Party, Child)>,
}

impl Crew {
    /// Starts `parties` with the configuration file `config`; their logs go to `logs`.
    ///
    /// # Errors
    /// A process cannot be started.
    pub fn start(parties: &[Party], config: &Path, logs: &Path) -> Result<Self, Failure> {
        let mut crew = Self { members: Vec::new() };
        for &party in parties.iter().filter(|&&party| party != Party::Recorder) {
            let member = Child::start(party.name(), command(&[party.name()], config)?, logs)?;
            crew.members.push((party, member));
        }
        Ok(crew)
    }

    /// A failure if one of them has ended.
    pub fn fallen(&mut self) -> Option<Failure> {
        self.members.iter_mut().find_map(|(_, member)| member.fallen())
    }

    /// Asks all to end, the daemon first so that it leaves the vehicle neutral, and waits for them.
    pub fn dismiss(&mut self) {
        for leaving in [Party::Daemon, Party::Mocap, Party::Plant] {
            for (_, member) in self.members.iter_mut().filter(|(party, _)| *party == leaving) {
                member.dismiss();
            }
        }
        self.members.clear();
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        self.dismiss();
    }
}
