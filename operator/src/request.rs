//! A request to the daemon, and its answer.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::obeying::{ObeyingProcess, quoted};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure};

use crate::reach::{name_of, place_of, root_of};
use crate::running::RunningProcesses;

/// Time within which a running daemon answers.
const ANSWER_TIMEOUT: Span = Span::from_millis(2000);
/// Time between two checks whether an instance has started.
const START_POLL: std::time::Duration = std::time::Duration::from_millis(20);

/// Sends a command that expires to the daemon; `None` without an answer. `expected`: hash of the configuration that the daemon
/// must run with.
pub fn request(
    bus: &Bus,
    command: OperatorCommand,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    send(bus, ControlRequestV1::of(command), expected)
}

/// As [`request`], for a request with a content.
pub fn send(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    send_signed(bus, request.by("oqtal"), expected)
}

/// As [`send`], for a request with its author.
pub fn send_signed(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    let valid_until = Time::now() + ANSWER_TIMEOUT;
    let config_hash = expected.unwrap_or(0);
    let request = ControlRequestV1 { valid_until, config_hash, ..request };
    bus.control_client()?.ask(request, ANSWER_TIMEOUT)
}

/// The bus of the instance at `paths`, which may just be starting.
///
/// # Errors
/// No process of the instance runs (exit code 75), or the bus refuses.
pub fn running_bus(paths: &InstancePaths) -> Result<Bus, Failure> {
    let give_up = Time::now() + ANSWER_TIMEOUT;
    loop {
        if let Some(bus) = Bus::open_running(paths)? {
            return Ok(bus);
        }
        if Time::now() > give_up {
            return Err(no_answer(paths, |_| true));
        }
        std::thread::sleep(START_POLL);
    }
}

/// Failure of a command without an answer on the bus of a running instance: names a daemon that runs and does not answer.
pub fn unanswered(bus: &Bus) -> Failure {
    let paths = bus.paths();
    let instance = &paths.instance;
    let Ok(Some(daemon)) = bus.holder(&Role::Daemon.health()) else { return silent(paths) };
    let message = format!(
        "{daemon} runs on instance `{instance}`, but does not answer: it hangs, or was stopped by a signal; continue it by SIGCONT, or end \
         it; `oqtal ctl stop --instance {instance}` stops the motors"
    );
    Failure::new(Exit::Peer, message)
}

/// Failure of a command to an instance without a daemon on its bus: names a daemon that runs nevertheless.
pub fn silent(paths: &InstancePaths) -> Failure {
    no_answer(paths, |process| !process.is_vehicle)
}

/// Failure of a command to the instance at `paths`: names its process, of those that `is_meant` selects, under this root or another.
fn no_answer(paths: &InstancePaths, is_meant: impl Fn(&ObeyingProcess) -> bool) -> Failure {
    let (instance, place) = (&paths.instance, place(paths));
    let (all, others): (Vec<_>, Vec<_>) =
        ObeyingProcess::all().into_iter().partition(|process| process.is_of_instance(instance));
    let running: Vec<_> = all.iter().filter(|process| is_meant(process)).collect();
    if let Some(process) = running.iter().find(|process| process.is_under(paths)) {
        let reason = if process.sees_other_files(paths) {
            "it runs in a container, or with a private file system: give this command there"
        } else if process.has_lost_files() {
            "files of the instance were removed, so it lands if it flies, and ends"
        } else {
            "it is starting or ending, or files of the instance were just removed or moved"
        };
        let message = format!(
            "{} of instance `{instance}` runs, but cannot be reached: {reason}; `oqtal ctl stop {place}` reaches it from here",
            name_of(process)
        );
        return Failure::new(Exit::Peer, message);
    }
    let nobody = format!("no daemon answers on instance `{instance}`");
    if let Some(vehicle) = all.iter().find(|process| process.is_vehicle && process.is_under(paths))
    {
        let message = format!(
            "{nobody}, but {} runs: the vehicle may fly, `oqtal ctl stop {place}` stops its motors; {}",
            name_of(vehicle),
            daemon_remedy(paths)
        );
        return Failure::new(Exit::Peer, message);
    }
    let Some(&process) = running.first() else {
        let mut lines = vec![format!("{nobody}; {}", daemon_remedy(paths))];
        lines.extend(others.iter().map(|other| format!("  running: {}", place_of(other))));
        return Failure::new(Exit::Peer, lines.join("\n"));
    };
    runs_elsewhere(process, paths, &nobody)
}

/// Time left until `give_up`.
pub(crate) fn left(give_up: Time) -> Duration {
    Duration::from_nanos(give_up.since(Time::now()).nanos().max(0).unsigned_abs())
}

/// Flags of a command that address the instance at `paths`.
pub fn place(paths: &InstancePaths) -> String {
    let InstancePaths { instance, root } = paths;
    match InstancePaths::new(instance, None).is_ok_and(|default| default == *paths) {
        true => format!("--instance {instance}"),
        false => format!("--instance {instance} --root {}", quoted(&root.display().to_string())),
    }
}

/// Command that starts a daemon of the instance at `paths`, with the configuration of the one before if that is left.
pub fn start_daemon(paths: &InstancePaths) -> String {
    let place = place(paths);
    let file = Some(paths.config()).filter(|file| file.is_file());
    let config = file.map(|file| format!(" --config {}", quoted(&file.display().to_string())));
    let user = paths.user_to_become().map(|user| format!("sudo -u '#{user}' "));
    format!("{}oqtal daemon run{} {place}", user.unwrap_or_default(), config.unwrap_or_default())
}

/// Remedy of a missing daemon at `paths`.
fn daemon_remedy(paths: &InstancePaths) -> String {
    if let Some(process) = RunningProcesses::observe(paths).of_other_config(paths) {
        return format!("start one {}", config_of(process));
    }
    let like = if paths.config().is_file() {
        ""
    } else {
        ", with the --config of the instance if it has one"
    };
    format!("start one with `{}`{like}", start_daemon(paths))
}

/// Configuration of a daemon beside `process`, which runs with another one than the daemon before.
pub(crate) fn config_of(process: &str) -> String {
    format!(
        "with the --config and --set of {process}: config.toml of the instance is of a daemon with other settings"
    )
}

/// Failure of a command to the instance at `paths`, whose `process` runs under another root; `nobody` states that none does here.
fn runs_elsewhere(process: &ObeyingProcess, paths: &InstancePaths, nobody: &str) -> Failure {
    let other = root_of(process, paths)
        .map_or_else(|| "another root".to_owned(), |root| format!("--root {}", root.display()));
    let (exit, remedy) = match process.is_ours() {
        true => (Exit::Peer, "give that root"),
        false => (Exit::Permission, "run as that user, or as root with that root"),
    };
    let message = format!(
        "{nobody} in {}; {} of user {} runs it under {other}: {remedy}",
        paths.root.display(),
        name_of(process),
        process.user
    );
    Failure::new(exit, message)
}
