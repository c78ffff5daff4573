//! The processes of a flight.

use std::fs::{self, Metadata};
use std::path::Path;
use std::time::Duration;

use oqtal_bus::process::{Exit, Failure};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Party;

use super::Mission;

use crate::child::{Child, command};

/// A process has so long to come up.
pub const PATIENCE: Span = Span::from_millis(10_000);

/// The processes of a flight. None outlives it: they end when it is dropped, and when this process dies.
#[derive(Debug)]
pub struct Crew {
    members: Vec<(Party, Child)>,
}

impl Crew {
    /// Starts those whom `mission` takes, with the configuration file `config`; their logs go to `logs`.
    ///
    /// # Errors
    /// A process cannot be started, or ends before the next one finds what it needs of it.
    pub fn start(mission: &Mission, config: &Path, logs: &Path) -> Result<Self, Failure> {
        let mut crew = Self { members: Vec::new() };
        let parties = mission.way.parties(&mission.config).iter();
        for &party in parties.filter(|&&party| party != Party::Recorder) {
            if let (Party::Bridge, Some(link)) = (party, mission.way.awaited()) {
                crew.wait_for(link, config)?;
            }
            let member = Child::start(party.name(), command(&[party.name()], config)?, logs)?;
            crew.members.push((party, member));
        }
        Ok(crew)
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

    /// Asks all to end, the daemon first so that it leaves the vehicle neutral, then the bridge, which says so; waits for each.
    pub fn dismiss(&mut self) {
        for leaving in [Party::Daemon, Party::Bridge, Party::Mocap, Party::Plant] {
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
