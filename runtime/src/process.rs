//! A process from its command line to its exit code: arguments, configuration, log, signals, panics.

use std::process::ExitCode;

use oqtal_bus::obeying::{LAND_SIGNAL, STOP_SIGNAL, thread_name};
use oqtal_bus::stop::SignalFlags;
use oqtal_bus::topic::Role;
use oqtal_config::Config;
use rustix::process::{Pid, Signal};

use crate::log;
use crate::lost_files::watched;
use crate::program::{conclude, guarded, print};
use crate::service;
use crate::stop::StopFlag;
use crate::watches::Watches;

pub use crate::args::{CommonArgs, PlantKeyArgs, ProcessCommand, SettingArgs, place_settings};
pub use crate::context::{ProcessContext, check_instance, instance_paths, paths_of, roles};
pub use crate::exit::{Exit, Failure};

use crate::health::Health;

/// Main function of a process.
pub type Job = fn(&ProcessContext) -> Result<(), Failure>;

/// Checks whether a process can run with a configuration that is valid in itself.
pub type Check = fn(&Config) -> Result<(), Failure>;

/// Executes the command for the process `role` with the main function `job`, and returns the exit code.
pub fn execute(role: Role, command: &ProcessCommand, job: Job, check: Check) -> ExitCode {
    execute_as(role.name(), role, command, (job, check))
}

/// Like [`execute`], for a process that `oqtal` calls `name` and that has the place of `role`.
pub fn execute_as(
    name: &str,
    role: Role,
    command: &ProcessCommand,
    (job, check): (Job, Check),
) -> ExitCode {
    let result = match command {
        ProcessCommand::Check(args) => load(args).and_then(|config| {
            check(&config)?;
            print(&describe(&config))
        }),
        ProcessCommand::Run(args) => run(name, role, args, job),
    };
    match result {
        Ok(()) => Exit::Ok.into(),
        Err(failure) => conclude(&format!("oqtal {name}"), &failure),
    }
}

/// The effective configuration as a file, preceded by comments with its hash, the rate of the loop and, for a vehicle with its own attitude
/// loop, with the part of the law that is used.
pub fn describe(config: &Config) -> String {
    let law = if config.vehicle.interface.holds_attitude() {
        "# the vehicle holds the attitude: the attitude law only steers a yaw axis that is commanded by its rate\n"
    } else {
        ""
    };
    let (hash, pace) = (config.hash(), config.pace());
    format!("# hash {hash:016x}\n# {pace}\n{law}{}", config.to_toml().trim_end())
}

fn load(args: &CommonArgs) -> Result<Config, Failure> {
    Ok(Config::load(&args.config, &args.settings()?)?)
}

fn run(name: &str, role: Role, args: &CommonArgs, job: Job) -> Result<(), Failure> {
    if let Some(parent) = args.child {
        die_with(parent)?;
    }
    let signals = obey_operators(role)?;
    let config = load(args)?;
    // An emulated vehicle at a wire, and a firmware executed as a program, are stopped through their bridge, like a real one.
    let is_stopped_by_bridge = role == Role::Plant && config.plant.is_simulated_behind_bridge();
    // Named once the handlers are installed: operators find the process by this name.
    let thread = thread_name(&instance_paths(&config)?, role);
    let _log = log::start(config.log.level, role, thread.filter(|_| !is_stopped_by_bridge));
    let stop = stop_on_signals()?;
    stop_on_panics(&stop);
    let context = ProcessContext {
        config,
        stop,
        signals,
        role,
        files: args.config.clone(),
        is_child: args.child.is_some(),
        health: Health::default(),
        watches: Watches::default(),
    };
    tracing::info!(
        instance = context.config.instance.name,
        config = format!("{:016x}", context.config.hash()),
        "{name} starts"
    );
    let result = guarded(|| service::notified(&context, || watched(&context, || job(&context))));
    tracing::info!("{name} ends");
    result
}

/// Installs the handlers of operators' signals in a process of a vehicle and in a daemon.
fn obey_operators(role: Role) -> Result<SignalFlags, Failure> {
    let flags = SignalFlags::default();
    if let Role::Plant | Role::Bridge | Role::Daemon = role {
        for (signal, flag) in [(STOP_SIGNAL, &flags.stop), (LAND_SIGNAL, &flags.land)] {
            signal_hook::flag::register(signal.as_raw(), flag.clone())
                .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
        }
    }
    Ok(flags)
}

/// Ends this process when its parent process `parent` dies, so that no orphan remains.
fn die_with(parent: i32) -> Result<(), Failure> {
    rustix::process::set_parent_process_death_signal(Some(Signal::TERM)).map_err(|e| {
        Failure::new(Exit::System, format!("setting the parent-death signal failed: {e}"))
    })?;
    // If the parent has already died, the signal is never sent.
    if rustix::process::getppid() == Pid::from_raw(parent) {
        Ok(())
    } else {
        let message = format!("process {parent}, which started this one, has ended");
        Err(Failure::new(Exit::Peer, message))
    }
}

/// Sets `stop` on a panic of any thread: the process must not continue without one of its threads.
fn stop_on_panics(stop: &StopFlag) {
    let stop = stop.clone();
    std::panic::set_hook(Box::new(move |panic| {
        stop.set();
        // Logged by the log thread: an output that does not drain must not prevent a loop from leaving its outputs safe.
        tracing::error!("{panic}");
    }));
}

/// Returns a stop flag that SIGINT and SIGTERM set.
///
/// # Errors
/// The operating system refuses, or the signals are already handled.
pub fn stop_on_signals() -> Result<StopFlag, Failure> {
    let stop = StopFlag::default();
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.set())
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
    Ok(stop)
}
