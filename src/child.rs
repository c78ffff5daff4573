//! A child process: this program, executed again as one of its processes.

use std::fs::File;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use rustix::process::{Pid, Signal, kill_process};

/// Time between the request to end and the kill.
const SHUTDOWN_TIMEOUT: Span = Span::from_millis(2000);
/// Number of lines of the log shown when a process has ended unexpectedly.
const LOG_TAIL_LINES: usize = 5;

/// A running child process. It is ended on drop, and ends when this process dies.
#[derive(Debug)]
pub struct Child {
    name: &'static str,
    process: std::process::Child,
    log: PathBuf,
}

/// Command that runs this program as the process named by `words`, with a configuration file.
///
/// # Errors
/// The executable file of this program was removed.
pub fn command(words: &[&str], config: &Path) -> Result<Command, Failure> {
    let mut command = program(words)?;
    command.args(["run", "--child", &std::process::id().to_string(), "--config"]);
    command.arg(config);
    Ok(command)
}

/// This program, executed again with `words`.
///
/// # Errors
/// The executable file of this program was removed.
pub fn program(words: &[&str]) -> Result<Command, Failure> {
    let path = std::env::current_exe()
        .map_err(|e| Failure::new(Exit::System, format!("finding this program failed: {e}")))?;
    let mut command = Command::new(path);
    command.args(words).stdin(Stdio::null());
    Ok(command)
}

impl Child {
    /// Starts `command`, with its log in the directory `logs`.
    ///
    /// # Errors
    /// The log cannot be created, or the process cannot be started.
    pub fn start(name: &'static str, command: Command, logs: &Path) -> Result<Self, Failure> {
        let log = logs.join(format!("{name}.log"));
        let file = files::create(&log).map_err(|e| failed_to_start(name, &log, &e))?;
        Ok(Self { name, process: spawn(name, command, file)?, log })
    }

    /// Starts `command` in place of a killed process, and appends to its log.
    ///
    /// # Errors
    /// Like [`Child::start`].
    pub fn restart(&mut self, command: Command) -> Result<(), Failure> {
        self.shut_down();
        let opened = File::options().append(true).open(&self.log);
        let file = opened.map_err(|e| failed_to_start(self.name, &self.log, &e))?;
        self.process = spawn(self.name, command, file)?;
        Ok(())
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// The failure if the process has ended; `None` while it runs.
    pub fn failure(&mut self) -> Option<Failure> {
        let status = self.process.try_wait().ok().flatten()?;
        Some(self.exit_report(status))
    }

    /// The failure if the process ended without success; `None` while it runs, and after a success.
    pub fn error(&mut self) -> Option<Failure> {
        let status = self.process.try_wait().ok().flatten()?;
        (!status.success()).then(|| self.exit_report(status))
    }

    /// Sends `signal` to the process; does nothing if it has ended.
    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = i32::try_from(self.id()).ok().and_then(Pid::from_raw) {
            // The process may have ended in the meantime.
            let _ = kill_process(pid, signal);
        }
    }

    /// Asks the process to end and waits for it; kills it after the shutdown timeout.
    pub fn shut_down(&mut self) {
        if let Ok(None) = self.process.try_wait() {
            self.signal(Signal::TERM);
            // A suspended process ends only after it is continued.
            self.signal(Signal::CONT);
            let _ = self.ends_within(SHUTDOWN_TIMEOUT);
        }
        // Both calls fail only if the process has already ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }

    /// Waits until the process ends without a request; `false` if it is still running after `timeout`.
    pub fn ends_within(&mut self, timeout: Span) -> bool {
        let deadline = Time::now() + timeout;
        while matches!(self.process.try_wait(), Ok(None)) {
            if Time::now() >= deadline {
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
        self.shut_down();
    }
}

/// Starts `command` with the log `file`.
fn spawn(name: &str, mut command: Command, file: File) -> Result<std::process::Child, Failure> {
    // The configuration file already includes variables and flags; a variable must not override a flag a second time.
    for (variable, _) in std::env::vars_os() {
        if variable.as_encoded_bytes().starts_with(b"OQTAL_") {
            command.env_remove(variable);
        }
    }
    // A separate process group: Ctrl-C in the terminal reaches this process only.
    command.stdout(Stdio::null()).stderr(file).process_group(0);
    let spawned = command.spawn();
    spawned.map_err(|e| failed_to_start(name, Path::new(command.get_program()), &e))
}

fn failed_to_start(name: &str, what: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(Exit::System, format!("starting {name} failed: {}: {error}", what.display()))
}

/// Exit code for a process that ended with `status`: the process's own if it is one of [`Exit`], otherwise that of a failed
/// flight.
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
