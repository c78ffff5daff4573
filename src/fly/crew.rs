//! The processes of a flight: started by executing this very program, watched, and seen home.

use std::fs::File;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use oqtal_bus::process::{Exit, Failure};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Party;
use rustix::process::{Pid, Signal, kill_process};

/// A process that was asked to end has so long before it is killed.
const FAREWELL: Span = Span::from_millis(2000);
/// Lines of a fallen process's log that are shown.
const LAST_WORDS: usize = 5;

/// One process of the crew.
#[derive(Debug)]
struct Member {
    party: Party,
    child: Child,
    log: PathBuf,
}

/// The processes of a flight. None outlives it: they end when it is dropped, and when this process dies.
#[derive(Debug)]
pub struct Crew {
    members: Vec<Member>,
}

impl Crew {
    /// Starts `parties` with the configuration file `config`; their logs go to `logs`.
    ///
    /// # Errors
    /// A process cannot be started.
    pub fn start(parties: &[Party], config: &Path, logs: &Path) -> Result<Self, Failure> {
        let mut crew = Self { members: Vec::new() };
        for &party in parties.iter().filter(|&&party| party != Party::Recorder) {
            crew.members.push(Member::start(party, config, logs)?);
        }
        Ok(crew)
    }

    /// A failure if one of them has ended.
    pub fn fallen(&mut self) -> Option<Failure> {
        self.members.iter_mut().find_map(|member| {
            let status = member.child.try_wait().ok().flatten()?;
            Some(member.obituary(status))
        })
    }

    /// Asks all to end, the daemon first so that it leaves the vehicle neutral, and waits for them.
    pub fn dismiss(&mut self) {
        for party in [Party::Daemon, Party::Mocap, Party::Plant] {
            for member in self.members.iter_mut().filter(|member| member.party == party) {
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

impl Member {
    fn start(party: Party, config: &Path, logs: &Path) -> Result<Self, Failure> {
        let failed = |what: &str, error: &dyn std::fmt::Display| {
            Failure::new(Exit::System, format!("starting {} failed: {what}: {error}", party.name()))
        };
        let program = std::env::current_exe().map_err(|e| failed("finding this program", &e))?;
        let log = logs.join(format!("{}.log", party.name()));
        let file = File::create(&log).map_err(|e| failed(&log.display().to_string(), &e))?;
        let mut command = Command::new(&program);
        // The file holds what variables and flags came to: a variable must not win over a flag in the second round.
        for (name, _) in std::env::vars_os() {
            if name.as_encoded_bytes().starts_with(b"OQTAL_") {
                command.env_remove(name);
            }
        }
        let child = command
            .args([party.name(), "run", "--child", &std::process::id().to_string(), "--config"])
            .arg(config)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(file)
            // Ctrl-C in the terminal is for the front door alone.
            .process_group(0)
            .spawn()
            .map_err(|e| failed(&program.display().to_string(), &e))?;
        Ok(Self { party, child, log })
    }

    fn obituary(&self, status: ExitStatus) -> Failure {
        let how = match (status.code(), status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (None, Some(signal)) => format!("was killed by signal {signal}"),
            (None, None) => "ended".to_owned(),
        };
        let log = std::fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = log.lines().collect();
        let last_words = lines[lines.len().saturating_sub(LAST_WORDS)..].join("\n  ");
        let message = format!(
            "{} {how}; its log, {}, ends with\n  {last_words}",
            self.party.name(),
            self.log.display()
        );
        Failure::new(exit_for(status), message)
    }

    fn dismiss(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw) {
                // It may have ended on its own meanwhile.
                let _ = kill_process(pid, Signal::TERM);
            }
            let give_up = Time::now() + FAREWELL;
            while Time::now() < give_up && matches!(self.child.try_wait(), Ok(None)) {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        // Neither matters once it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The front door ends as its process did where that has a code of ours; a killed one means that the flight failed.
fn exit_for(status: ExitStatus) -> Exit {
    let known = [
        Exit::Usage,
        Exit::Data,
        Exit::Internal,
        Exit::System,
        Exit::Peer,
        Exit::Version,
        Exit::Permission,
        Exit::Config,
    ];
    let code = status.code();
    known.into_iter().find(|exit| code == Some(*exit as i32)).unwrap_or(Exit::Flight)
}
