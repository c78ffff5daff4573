//! A process that the front door started by executing this very program: watched, and seen home.

use std::fs::File;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use rustix::process::{Pid, Signal, kill_process};

/// A process that was asked to end has so long before it is killed.
const SHUTDOWN_TIMEOUT: Span = Span::from_millis(2000);
/// Lines of a fallen process's log that are shown.
const LOG_TAIL_LINES: usize = 5;

/// A started process. It ends when this is dropped, and when the process that started it dies.
#[derive(Debug)]
pub struct Child {
    name: &'static str,
    process: std::process::Child,
    log: PathBuf,
}

/// This program with the words of a process and its configuration file.
///
/// # Errors
/// The program's own file is gone.
pub fn command(words: &[&str], config: &Path) -> Result<Command, Failure> {
    let program = std::env::current_exe()
        .map_err(|e| Failure::new(Exit::System, format!("finding this program failed: {e}")))?;
    let mut command = Command::new(program);
    command.args(words).args(["run", "--child", &std::process::id().to_string(), "--config"]);
    command.arg(config).stdin(Stdio::null());
    Ok(command)
}

impl Child {
    /// Starts `command`; its log goes to `logs`.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(name: &'static str, mut command: Command, logs: &Path) -> Result<Self, Failure> {
        let failed = |what: &Path, error: &dyn std::fmt::Display| {
            let message = format!("starting {name} failed: {}: {error}", what.display());
            Failure::new(Exit::System, message)
        };
        let log = logs.join(format!("{name}.log"));
        let file = File::create(&log).map_err(|e| failed(&log, &e))?;
        // The file holds what variables and flags came to: a variable must not win over a flag in the second round.
        for (variable, _) in std::env::vars_os() {
            if variable.as_encoded_bytes().starts_with(b"OQTAL_") {
                command.env_remove(variable);
            }
        }
        // Ctrl-C in the terminal is for the front door alone.
        command.stdout(Stdio::null()).stderr(file).process_group(0);
        let spawned = command.spawn();
        let process = spawned.map_err(|e| failed(Path::new(command.get_program()), &e))?;
        Ok(Self { name, process, log })
    }

    /// Its process id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// A failure if it has ended.
    pub fn fallen(&mut self) -> Option<Failure> {
        let status = self.process.try_wait().ok().flatten()?;
        Some(self.exit_report(status))
    }

    /// Asks it to end, and waits for it; a process that does not end is killed.
    pub fn dismiss(&mut self) {
        if let Ok(None) = self.process.try_wait() {
            if let Some(pid) = i32::try_from(self.id()).ok().and_then(Pid::from_raw) {
                // It may have ended on its own meanwhile.
                let _ = kill_process(pid, Signal::TERM);
            }
            let _ = self.ends_within(SHUTDOWN_TIMEOUT);
        }
        // Neither matters once it has ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }

    /// Waits for it to end by itself; `false` if it has not after `patience`.
    pub fn ends_within(&mut self, patience: Span) -> bool {
        let give_up = Time::now() + patience;
        while matches!(self.process.try_wait(), Ok(None)) {
            if Time::now() >= give_up {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        true
    }

    fn exit_report(&self, status: ExitStatus) -> Failure {
        let how = match (status.code(), status.signal()) {
            (Some(code), _) => format!("ended with exit code {code}"),
            (None, Some(signal)) => format!("was killed by signal {signal}"),
            (None, None) => "ended".to_owned(),
        };
        let log = std::fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = log.lines().collect();
        let log_tail = lines[lines.len().saturating_sub(LOG_TAIL_LINES)..].join("\n  ");
        let message = format!(
            "{} {how}; its log, {}, ends with\n  {log_tail}",
            self.name,
            self.log.display()
        );
        Failure::new(exit_for(status), message)
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.dismiss();
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
