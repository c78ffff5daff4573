//! A request to the daemon, and its answer.

use std::path::PathBuf;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1};
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::paths::{InstancePaths, quoted};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_observe::config_file;
use oqtal_observe::status::VehicleStatus;
use oqtal_runtime::flight_marker::FlightMarker;
use oqtal_runtime::process::{Exit, Failure};

use crate::reach::{name_of, place_of, root_of};
use crate::report::listed;
use crate::running::{OtherConfig, RunningProcesses};

/// Time within which a running daemon answers.
pub const ANSWER_TIMEOUT: Span = Span::from_millis(2000);
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

/// Like [`request`], for a request with a content.
pub fn send(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    send_signed(bus, request.by("oqtal"), expected)
}

/// Like [`send`], for a request with its author, and with the end of its validity if it was made before.
pub fn send_signed(
    bus: &Bus,
    request: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    let valid_until = match request.valid_until {
        Time::UNSET => Time::now() + ANSWER_TIMEOUT,
        stated => stated,
    };
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
    let Ok(Some(daemon)) = bus.holder(&Role::Daemon.health()) else {
        return no_answer(paths, is_daemon);
    };
    let message = format!(
        "{daemon} runs on instance `{instance}`, but does not answer: it executes a long request, hangs, or was stopped by a signal (SIGCONT \
         continues it); if `oqtal ctl status {0}` is not answered either, end the flight by `oqtal ctl land {0}` or `oqtal ctl stop {0}` \
         before the daemon is ended",
        paths.flags()
    );
    Failure::new(Exit::Peer, message)
}

/// Failure of a command to an instance without a daemon on its bus: names a daemon that runs nevertheless.
pub fn silent(paths: &InstancePaths) -> Failure {
    no_answer(paths, is_daemon)
}

fn is_daemon(process: &ObeyingProcess) -> bool {
    !process.is_vehicle
}

/// Failure of a command to the instance at `paths`: names its process, of those that `is_meant` selects, under this root, or those under
/// others.
fn no_answer(paths: &InstancePaths, is_meant: impl Fn(&ObeyingProcess) -> bool) -> Failure {
    let (instance, place) = (&paths.instance, paths.flags());
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
    let is_its_vehicle = |it: &&ObeyingProcess| it.is_vehicle && it.is_under(paths);
    if let Some(process) = all.iter().find(is_its_vehicle) {
        let seen = RunningProcesses::observe(paths);
        let (name, remedy) = (name_of(process), daemon_remedy(paths, &seen));
        let state = state_of_vehicle(seen.vehicle.as_ref(), &place);
        return Failure::new(Exit::Peer, format!("{nobody}, but {name} runs: {state}; {remedy}"));
    }
    if running.is_empty() {
        let seen = RunningProcesses::observe(paths);
        let mut lines = vec![format!("{nobody}; {}", daemon_remedy(paths, &seen))];
        lines.extend(others.iter().map(|other| format!("  running: {}", place_of(other))));
        return Failure::new(Exit::Peer, lines.join("\n"));
    }
    runs_elsewhere(&running, paths, &nobody)
}

/// Whether a vehicle without a daemon may fly; `vehicle` is its newest state, if it was seen.
fn state_of_vehicle(vehicle: Option<&VehicleStatus>, place: &str) -> String {
    match vehicle.is_some_and(VehicleStatus::motors_are_off) {
        true => "its motors are off".to_owned(),
        false => format!("the vehicle may fly, `oqtal ctl stop {place}` stops its motors"),
    }
}

/// Command that starts a daemon of the instance at `paths`, or its chain, with the configuration of the one before if that is left.
pub fn start_daemon(paths: &InstancePaths) -> String {
    let place = paths.flags();
    let file = Some(paths.config()).filter(|file| file.is_file());
    let config = file.map(|file| format!(" --config {}", quoted(&file.display().to_string())));
    let process = if config_file::is_of_chain(&paths.config()) { "chain" } else { "daemon" };
    format!("{}oqtal {process} run{} {place}", as_owner(paths), config.unwrap_or_default())
}

/// Prefix of a command that starts a process of the instance at `paths`, if this user is not its owner.
pub(crate) fn as_owner(paths: &InstancePaths) -> String {
    paths.user_to_become().map_or_else(String::new, |user| format!("sudo -u '#{user}' "))
}

/// Note for the answers of the daemon at `paths`: files of its configuration that were removed, or with edits that it does not use; `None`
/// if there are none.
pub fn edited_note(paths: &InstancePaths) -> Option<String> {
    let (files, place) = (config_file::edited_files(&paths.config(), true), paths.flags());
    let (files, removed): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| file.exists());
    let removed = (!removed.is_empty()).then(|| {
        format!("{}: removed; the daemon keeps the settings that it has read", listed(&removed))
    });
    let edited = (!files.is_empty()).then(|| {
        let reload = |file: &str| format!("`oqtal ctl reload {file}{place}`");
        let named = |file: &PathBuf| reload(&(quoted(&file.display().to_string()) + " "));
        let is_copy = config_file::is_copy(&paths.config());
        let reloads: Vec<_> =
            if is_copy { files.iter().map(named).collect() } else { vec![reload("")] };
        let all = if is_copy { " (takes every setting of the file, also those that later files and flags had replaced)" } else { "" };
        format!(
            "{}: edited without effect on the daemon; to apply an edit of settings that can change while the daemon runs: {}{all}; a restart \
             of every process applies any edit",
            listed(&files),
            reloads.join(" and ")
        )
    });
    let notes: Vec<_> = edited.into_iter().chain(removed).chain(waypoints_note(paths)).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Note on the waypoint file of the daemon at `paths`, if it was edited or removed after the daemon had read it.
pub fn waypoints_note(paths: &InstancePaths) -> Option<String> {
    let file = config_file::edited_waypoints(&paths.config())?;
    let name = file.display().to_string();
    Some(match file.exists() {
        true => format!(
            "{name}: edited since the daemon read it; `oqtal ctl set trajectory.waypoints-file={} {}` reads it again",
            quoted(&name),
            paths.flags()
        ),
        false => format!("{name}: removed; the daemon keeps the waypoints that it has read"),
    })
}

/// Note on a daemon started with the copy at `paths`: what it lacks; `None` if no file was edited or removed after the start of the
/// last one, or if this user cannot read the copy.
pub(crate) fn start_without(paths: &InstancePaths) -> Option<String> {
    let files = config_file::edited_files(&paths.config(), false);
    let (files, removed): (Vec<_>, Vec<_>) = files.into_iter().partition(|file| file.exists());
    let (edits, remedy) = match &files[..] {
        [] if removed.is_empty() => return None,
        [] => (String::new(), ""),
        files => (
            format!("without later edits of {} and ", listed(files)),
            "; to fly with the edits, give the files themselves by --config",
        ),
    };
    let removed = match &removed[..] {
        [] => String::new(),
        [file] => format!("; {} was removed", file.display()),
        removed => format!("; {} were removed", listed(removed)),
    };
    Some(format!(
        "that uses the settings with which the last daemon was started, {edits}without changes made while it ran{remedy}{removed}"
    ))
}

/// Remedy of a missing daemon at `paths`, where the processes `seen` run.
fn daemon_remedy(paths: &InstancePaths, seen: &RunningProcesses) -> String {
    if let Some(other) = seen.of_other_config(paths) {
        return start_beside(other, paths);
    }
    if let Some(command) = config_file::flight_of(&paths.config()) {
        return format!(
            "the flight of this instance has ended or is ending; to fly again: `{command}`"
        );
    }
    let like = match paths.config() {
        file if !file.is_file() => ", with the --config of the instance if it has one",
        file if config_file::arms_at_start(&file) && !FlightMarker::of(paths).is_set() => {
            "; it takes off by itself (safety.arm-at-start)"
        }
        _ => "",
    };
    let edited = start_without(paths).map(|note| format!("; {note}"));
    format!("start one with `{}`{like}{}", start_daemon(paths), edited.unwrap_or_default())
}

/// Start of a daemon at `paths` beside a process with another configuration than the last one, in words.
pub(crate) fn start_beside(other: OtherConfig<'_>, paths: &InstancePaths) -> String {
    let OtherConfig { process, is_common } = other;
    match is_common {
        true => format!(
            "start a daemon with the --config and --set of {process}: config.toml of the instance has other settings, of another daemon or by \
             an edit"
        ),
        false => format!(
            "restart {process} with the --config and --set of the last daemon, and start a daemon with `{}`",
            start_daemon(paths)
        ),
    }
}

/// Failure of a command to the instance at `paths`, whose `processes` run under other roots; `nobody` states that none does here.
fn runs_elsewhere(processes: &[&ObeyingProcess], paths: &InstancePaths, nobody: &str) -> Failure {
    let mut roots: Vec<ElsewhereRoot> = Vec::new();
    for process in processes {
        let root = root_of(process, paths);
        let root = root
            .map_or_else(|| "another root".to_owned(), |root| format!("--root {}", root.display()));
        if roots.iter().all(|it| it.root != root) {
            let process_name = format!("{} of user {}", name_of(process), process.user);
            roots.push(ElsewhereRoot { process: process_name, root, is_ours: process.is_ours() });
        }
    }
    let is_ours = roots.iter().any(|it| it.is_ours);
    let exit = if is_ours { Exit::Peer } else { Exit::Permission };
    Failure::new(exit, elsewhere_text(&format!("{nobody} in {}", paths.root.display()), &roots))
}

/// Root under which an instance of the same name runs, as a flag, with one of its processes.
struct ElsewhereRoot {
    process: String,
    root: String,
    /// Whether this user may address it.
    is_ours: bool,
}

/// Message of [`runs_elsewhere`]: one line for a single root, else a line for each.
fn elsewhere_text(nobody: &str, roots: &[ElsewhereRoot]) -> String {
    let line = |ElsewhereRoot { process, root, is_ours }: &ElsewhereRoot| {
        let remedy = match is_ours {
            true => "give that root",
            false => "run as that user, or as root with that root",
        };
        format!("{process} runs it under {root}: {remedy}")
    };
    let lines: Vec<String> = roots.iter().map(line).collect();
    match &lines[..] {
        [line] => format!("{nobody}; {line}"),
        lines => format!("{nobody}; it runs under other roots\n  {}", lines.join("\n  ")),
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::code::VehicleLink;
    use oqtal_bus::message::VehicleV1;

    use super::*;

    #[test]
    fn every_other_root_of_the_name_is_told() {
        let of = |pid: u32, root: &str, is_ours| ElsewhereRoot {
            process: format!("the daemon, {pid} of user 0"),
            root: format!("--root {root}"),
            is_ours,
        };
        let nobody = "no daemon answers on instance `a` in /c";
        let one = elsewhere_text(nobody, &[of(7, "/a", true)]);
        assert_eq!(
            one,
            format!("{nobody}; the daemon, 7 of user 0 runs it under --root /a: give that root")
        );
        let two = elsewhere_text(nobody, &[of(7, "/a", true), of(8, "/b", false)]);
        let lines: Vec<&str> = two.lines().collect();
        assert!(lines.len() == 3 && lines[0].starts_with(nobody), "{two}");
        assert!(lines[1].ends_with("under --root /a: give that root"), "{two}");
        assert!(lines[2].contains("under --root /b: run as that user"), "{two}");
    }

    #[test]
    fn the_remedy_says_that_a_daemon_takes_off_by_itself() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        std::fs::create_dir_all(paths.directory()).unwrap();
        let remedy = |safety: &str| {
            std::fs::write(paths.config(), format!("[safety]\n{safety}\n")).unwrap();
            daemon_remedy(&paths, &RunningProcesses::default())
        };
        assert!(remedy("arm-at-start = true").contains("it takes off by itself"));
        assert!(!remedy("").contains("takes off"));
    }

    #[test]
    fn the_remedy_after_a_flight_is_its_command_since_its_files_are_removed() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        std::fs::create_dir_all(paths.directory()).unwrap();
        let command = "oqtal fly --seed 7";
        std::fs::write(paths.config(), format!("# of the flight {command}\n")).unwrap();
        let remedy = daemon_remedy(&paths, &RunningProcesses::default());
        assert!(remedy.ends_with("to fly again: `oqtal fly --seed 7`"), "{remedy}");
    }

    #[test]
    fn a_removed_file_is_not_said_to_be_edited() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        std::fs::create_dir_all(paths.directory()).unwrap();
        let file = root.path().join("x.toml");
        // No file has settings with this hash.
        std::fs::write(paths.config(), format!("# read from 0 {}\n", file.display())).unwrap();
        std::fs::write(&file, "").unwrap();
        let edited = start_without(&paths).unwrap();
        assert!(edited.contains("later edits of") && !edited.contains("removed"), "{edited}");
        std::fs::remove_file(&file).unwrap();
        let told = start_without(&paths).unwrap();
        let end =
            format!("started, without changes made while it ran; {} was removed", file.display());
        assert!(told.ends_with(&end), "{told}");
    }

    #[test]
    fn a_vehicle_whose_motors_are_off_is_not_said_to_fly() {
        let state = |armed, starting| {
            let simulated = VehicleV1 { simulated: 1, link: 1, ..VehicleV1::default() };
            let vehicle = VehicleV1 { armed, starting, ..simulated };
            state_of_vehicle(Some(&VehicleStatus::new(&vehicle)), "--instance a")
        };
        assert_eq!(state(0, 0), "its motors are off");
        let flies = "the vehicle may fly, `oqtal ctl stop --instance a` stops its motors";
        assert_eq!([state(1, 0), state(0, 1)], [flies; 2]);
        assert_eq!(state_of_vehicle(None, "--instance a"), flies, "its state was not seen");
        let link = VehicleLink::MotorsUnknown.code();
        let unknown = VehicleStatus::new(&VehicleV1 { link, ..VehicleV1::default() });
        assert_eq!(state_of_vehicle(Some(&unknown), "--instance a"), flies);
        assert!(unknown.to_string().starts_with("real, answers, motors unknown"), "{unknown}");
    }
}
