//! The context around every process: arguments, configuration, logs, signals, exit codes. What runs inside knows none of it.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use rustix::process::{Pid, Signal};

use crate::health::Heartbeat;
use crate::log;
use crate::loop_clock::{LoopClock, StopFlag};
use crate::program::{conclude, guarded, print};
use crate::realtime;
use crate::service::{self, Health};
use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::topic::{Role, Topic};
use oqtal_config::{ClockKind, Config, ConfigError, Setting, Violation};

/// How a process ends (sysexits.h, and 1 for a flight that did not end as asked).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// As asked.
    Ok = 0,
    /// The flight did not end as asked.
    Flight = 1,
    /// The command line is wrong.
    Usage = 64,
    /// Input data is bad.
    Data = 65,
    /// A fault of ours.
    Internal = 70,
    /// The operating system refused.
    System = 71,
    /// Another controller holds the topic, or a peer never came.
    Peer = 75,
    /// The running processes speak another version.
    Version = 76,
    /// No permission.
    Permission = 77,
    /// The configuration is wrong.
    Config = 78,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Why a process cannot do its job: the message for a person, the code for a supervisor.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// Object and remedy.
    pub message: String,
}

impl Failure {
    /// A failure with its code and message.
    #[must_use]
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into() }
    }
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Self {
        let exit = match &error {
            BusError::Held { .. } => Exit::Peer,
            BusError::Version { .. } => Exit::Version,
            BusError::Permission { .. } => Exit::Permission,
            BusError::Name { .. } => Exit::Usage,
            BusError::Full { .. } | BusError::Locked { .. } | BusError::System { .. } => {
                Exit::System
            }
        };
        Self::new(exit, error.to_string())
    }
}

impl From<Violation> for Failure {
    fn from(violation: Violation) -> Self {
        Self::new(Exit::Config, violation.to_string())
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::new(Exit::Config, error.to_string())
    }
}

/// What every process can be told on its command line.
#[derive(Args, Clone, Debug, Default)]
pub struct CommonArgs {
    /// Configuration file (TOML); see `oqtal check`
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Which testbed on this machine: 1 to 32 of a-z, 0-9 and -
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
    /// Directory of the instance's files
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Any key of the configuration, as in --set vehicle.mass-kg=0.6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// End when the process that started this one dies
    #[arg(long, hide = true, value_name = "PID")]
    pub child: Option<i32>,
}

impl CommonArgs {
    /// These flags as settings.
    ///
    /// # Errors
    /// A `--set` without `=`.
    pub fn settings(&self) -> Result<Vec<Setting>, ConfigError> {
        let mut settings = Vec::new();
        for text in &self.settings {
            settings.push(Setting::parse("--set", text)?);
        }
        if let Some(name) = &self.instance {
            settings.push(Setting::flag("--instance", "instance.name", name.clone()));
        }
        if let Some(root) = &self.root {
            let root = root.display().to_string();
            settings.push(Setting::flag("--root", "instance.root", root));
        }
        Ok(settings)
    }
}

/// What can be done with a process.
#[derive(Subcommand, Clone, Debug)]
pub enum ProcessCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(CommonArgs),
    /// Check the configuration the process would run with, and print it
    Check(CommonArgs),
}

/// The job of one process, inside the context.
pub type Job = fn(&ProcessContext) -> Result<(), Failure>;

/// Whether a process could do its job with a configuration that is valid by itself.
pub type Check = fn(&Config) -> Result<(), Failure>;

/// What a running process has of its surroundings.
#[derive(Debug)]
pub struct ProcessContext {
    /// The effective configuration.
    pub config: Config,
    /// Set when the process is asked to end.
    pub stop: StopFlag,
    /// Which process this is.
    pub role: Role,
    /// What the service manager reads from this process.
    pub health: Health,
}

impl ProcessContext {
    /// Joins the instance.
    ///
    /// # Errors
    /// As [`Bus::open`].
    pub fn bus(&self) -> Result<Bus, BusError> {
        Bus::open(&self.place()?)
    }

    /// What says that this process is well.
    ///
    /// # Errors
    /// The process runs already, or the bus refuses.
    pub fn heartbeat(&self, bus: &Bus) -> Result<Heartbeat, BusError> {
        Heartbeat::new(bus, self.role, self.config.hash())
    }

    /// The place that the configuration names.
    ///
    /// # Errors
    /// A bad instance name.
    pub fn place(&self) -> Result<InstancePaths, BusError> {
        instance_paths(&self.config)
    }

    /// Readies the calling thread for its loop; in virtual time there is nothing to be late for. Threads started before are
    /// left as they are.
    pub fn enter_realtime(&self) {
        if self.config.clock.kind != ClockKind::Real {
            return;
        }
        let granted = realtime::enter(&self.config.realtime);
        for refusal in &granted.refused {
            tracing::warn!("{refusal}");
        }
        let realtime::Granted { policy, priority, cpu, locked, .. } = granted;
        tracing::debug!(policy, priority, ?cpu, locked, "loop is ready");
    }

    /// The pacer of this process: real time, woken by `wakes_on`, or virtual time. The plant leads virtual time; where a
    /// recording is played there is no plant, and the cameras lead.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn pace<M: Message>(&self, bus: &Bus, wakes_on: &Topic<M>) -> Result<LoopClock, BusError> {
        let (stop, roles) = (self.stop.clone(), roles(&self.config));
        let pace = if self.config.clock.kind == ClockKind::Real {
            LoopClock::real(bus, wakes_on, stop)
        } else if self.role == roles[0] {
            LoopClock::leader(bus, self.role, roles, stop)
        } else {
            LoopClock::follower(bus, self.role, stop)
        };
        Ok(pace?.counted_in(self.health.clone()))
    }
}

/// Who takes part in the loop; the first leads virtual time.
#[must_use]
pub fn roles(config: &Config) -> &'static [Role] {
    if config.is_replay() { &Role::ALL[1..] } else { &Role::ALL }
}

/// The place that a configuration names.
///
/// # Errors
/// A bad instance name.
pub fn instance_paths(config: &Config) -> Result<InstancePaths, BusError> {
    let root = Some(&config.instance.root).filter(|root| !root.is_empty());
    InstancePaths::new(&config.instance.name, root.map(std::path::Path::new))
}

/// Does what the command line asks of `role`, whose job is `job`, and says how it ended.
#[must_use]
pub fn execute(role: Role, command: &ProcessCommand, job: Job, check: Check) -> ExitCode {
    let result = match command {
        ProcessCommand::Check(args) => load(args).and_then(|config| {
            check(&config)?;
            print(&describe(&config))
        }),
        ProcessCommand::Run(args) => run(role, args, job),
    };
    match result {
        Ok(()) => Exit::Ok.into(),
        Err(failure) => conclude(&format!("oqtal {}", role.name()), &failure),
    }
}

/// The effective configuration as a file, under a comment that says at which rate the loop will run.
#[must_use]
pub fn describe(config: &Config) -> String {
    format!("# {}\n{}", config.pace(), config.to_toml().trim_end())
}

fn load(args: &CommonArgs) -> Result<Config, Failure> {
    Ok(Config::load(args.config.as_deref(), &args.settings()?)?)
}

fn run(role: Role, args: &CommonArgs, job: Job) -> Result<(), Failure> {
    if let Some(parent) = args.child {
        die_with(parent)?;
    }
    let config = load(args)?;
    log::start(config.log.level, role);
    let stop = stop_on_signals()?;
    stop_on_panics(&stop);
    let context = ProcessContext { config, stop, role, health: Health::default() };
    tracing::info!(
        instance = context.config.instance.name,
        config = format!("{:016x}", context.config.hash()),
        "{} starts",
        role.name()
    );
    let result = guarded(|| service::attended(&context, || job(&context)));
    // Its ports are closed; whoever leaves last tidies up.
    if let Ok(bus) = context.bus() {
        drop(bus);
    }
    tracing::info!("{} ends", role.name());
    result
}

/// Ends this process when `parent`, which started it, dies: a front door that is killed leaves no orphans.
fn die_with(parent: i32) -> Result<(), Failure> {
    rustix::process::set_parent_process_death_signal(Some(Signal::TERM)).map_err(|e| {
        Failure::new(Exit::System, format!("binding to the parent's life failed: {e}"))
    })?;
    // It may have died before: then the signal never comes.
    if rustix::process::getppid() == Pid::from_raw(parent) {
        Ok(())
    } else {
        let message = format!("process {parent}, which started this one, has ended");
        Err(Failure::new(Exit::Peer, message))
    }
}

/// A panic on any thread ends the whole process in good order: half of one must not go on.
fn stop_on_panics(stop: &StopFlag) {
    let (report, stop) = (std::panic::take_hook(), stop.clone());
    std::panic::set_hook(Box::new(move |panic| {
        stop.set();
        report(panic);
    }));
}

/// Sets the flag on SIGINT or SIGTERM.
fn stop_on_signals() -> Result<StopFlag, Failure> {
    let stop = StopFlag::default();
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.set())
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
    Ok(stop)
}
