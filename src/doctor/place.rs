//! Checks of the files of instances, files left by killed processes, and serial ports.

use std::collections::BTreeSet;
use std::os::unix::fs::{MetadataExt, PermissionsExt};

use oqtal_bus::remains::{self, RunRemains};
use oqtal_runtime::process::Exit;

use super::finding::Finding;
use super::system::System;

/// Free space in the root below which no flight is possible \[bytes\]: an instance of three processes has 81 files of together 132 KiB.
const LEAST_FREE: u64 = 1 << 20;

/// Bit of the mode of a directory in which only its owner and that of a file may remove the file.
const STICKY: u32 = 0o1000;

/// Checks whether instances can be created.
pub fn root(system: &System) -> Option<Finding> {
    let directory = system.instances.display();
    let why = "processes find each other by files there, and all of them must run as one user";
    let finding = |found: String| Finding::ok("instances", why, found);
    if let Some(owner) = system.instances_owner.map(|owner| system.user(owner)) {
        // Taking it over would end the flights of its owner.
        let remedy = format!(
            "sudo -u {owner} oqtal doctor --root {directory} # for flights of that user; for your own: OQTAL_INSTANCE__ROOT=/tmp/oqtal-$UID"
        );
        let found = finding(format!("{directory} belongs to user {owner}"));
        return Some(found.forbid(Exit::Permission, remedy));
    }
    let full = system.instances_free.filter(|free| *free < LEAST_FREE);
    Some(if !system.instances.is_absolute() {
        finding(format!("{directory} is not an absolute path"))
            .forbid(Exit::Usage, format!("oqtal doctor --root \"$PWD\"/{directory}"))
    } else if !system.instances_writable {
        finding(format!("{directory} cannot be written by this user"))
            .forbid(Exit::Permission, format!("sudo install -d -o \"$USER\" {directory}"))
    } else if let Some(free) = full {
        finding(format!("{directory} has only {} KiB free", free / 1024)).forbid(
            Exit::System,
            format!("df {directory} # then free 1 MiB there, or give another --root"),
        )
    } else {
        finding(format!("in {directory}"))
    })
}

/// Checks whether others can remove the files of an instance.
pub fn sharing(system: &System) -> Option<Finding> {
    let directory = system.instances.display();
    if system.instances_owner.is_some() {
        return None;
    }
    let path = system.root.join(system.instances.strip_prefix("/").unwrap_or(&system.instances));
    let mode = std::fs::metadata(path).map_or(0, |metadata| metadata.permissions().mode());
    let why = "who may write there can remove the files of a flight, which is then landed";
    let finding = |found: String| Finding::ok("sharing", why, found);
    let is_sticky = mode & STICKY != 0;
    Some(match mode & 0o022 {
        0 => finding(format!("nobody else may write in {directory}")),
        // As `/tmp`, which must stay so.
        _ if is_sticky => finding(format!(
            "others may write in {directory}, but only remove what is theirs (sticky)"
        )),
        _ => finding(format!("others may write in {directory}"))
            .advise(format!("chmod go-w {directory}")),
    })
}

/// Checks whether the log-out of this user removes the shared memory of running processes.
pub fn log_out(system: &System) -> Option<Finding> {
    let user = system.value("proc/self/status", "Uid").unwrap_or_default();
    let user: u32 = user.split_whitespace().next().and_then(|user| user.parse().ok()).unwrap_or(0);
    let why = "with RemoveIPC=yes, systemd removes the shared memory of a user at the last log-out; a flight is then landed";
    let finding = |found: &str| Finding::ok("log-out", why, found);
    let is_lingering = std::env::var("USER")
        .is_ok_and(|name| system.list("var/lib/systemd/linger").contains(&name));
    // systemd exempts users of the system.
    let is_exempt = user < FIRST_USER || is_lingering;
    let has_logind = system.list("run/systemd").iter().any(|name| name == "system");
    Some(match has_logind && !is_exempt && removes_ipc(system) {
        false => finding("keeps shared memory"),
        true => finding("removes the shared memory of running processes").advise(
            "sudo mkdir -p /etc/systemd/logind.conf.d; printf '[Login]\\nRemoveIPC=no\\n' | sudo tee /etc/systemd/logind.conf.d/oqtal.conf # then restart the machine",
        ),
    })
}

/// First number of users who are persons.
const FIRST_USER: u32 = 1000;

/// Whether `RemoveIPC=` of systemd-logind is yes, its default.
fn removes_ipc(system: &System) -> bool {
    let main = ["usr/lib/systemd/logind.conf", "etc/systemd/logind.conf"].map(str::to_owned);
    let more = ["usr/lib/systemd/logind.conf.d", "etc/systemd/logind.conf.d"].map(|directory| {
        let names = system.list(directory).into_iter();
        names.map(|name| format!("{directory}/{name}")).collect::<Vec<_>>()
    });
    let files = main.into_iter().chain(more.into_iter().flatten());
    let mut values = files.rev().filter_map(|file| {
        let text = system.read(&file)?;
        let line = text.lines().rev().find_map(|line| line.trim().strip_prefix("RemoveIPC="))?;
        Some(["yes", "true", "on", "1"].contains(&line.trim().to_lowercase().as_str()))
    });
    values.next().unwrap_or(true)
}

/// Checks for objects in shared memory without a running process.
pub fn remains(system: &System) -> Option<Finding> {
    let strays = strays(system);
    let why =
        "a killed process frees no shared memory; the next of its instance does, others never";
    let finding = |found: String| Finding::ok("remains of dead instances", why, found);
    Some(match strays.is_empty() {
        true => finding("none".to_owned()),
        false => {
            let all: Vec<_> = strays.iter().map(described).collect();
            finding(all.join(", ")).advise("oqtal doctor --remove-strays")
        }
    })
}

/// Removes objects in shared memory without a running process; returns what was removed.
pub fn remove_strays(system: &System) -> Vec<String> {
    let strays = strays(system);
    strays.iter().for_each(RunRemains::remove);
    strays.iter().map(described).collect()
}

fn described(run: &RunRemains) -> String {
    format!("{} ({} objects)", run.instance, run.objects.len())
}

/// Runs of instances in shared memory without a running process, as far as this user can remove them.
fn strays(system: &System) -> Vec<RunRemains> {
    let mapped = mapped(system);
    let user = rustix::process::geteuid();
    let is_ours = |run: &RunRemains| {
        let mut owners = run.objects.iter().filter_map(|path| std::fs::symlink_metadata(path).ok());
        user.is_root() || owners.all(|object| object.uid() == user.as_raw())
    };
    let runs = remains::runs(&system.root.join("dev/shm"), "oqtal_").into_iter();
    runs.filter(|run| !run.is_alive() && is_ours(run) && !mapped.contains(&run.name)).collect()
}

/// Names of runs whose objects are mapped by a process: members keep them although the directory of the run was removed.
fn mapped(system: &System) -> BTreeSet<String> {
    let mut held = BTreeSet::new();
    let processes = system.list("proc");
    for pid in processes.iter().filter(|name| name.bytes().all(|digit| digit.is_ascii_digit())) {
        let maps = system.read(&format!("proc/{pid}/maps")).unwrap_or_default();
        let files = maps.lines().filter_map(|line| line.split("/dev/shm/").nth(1));
        held.extend(files.filter_map(remains::run_name).map(str::to_owned));
    }
    held
}

/// Checks the permissions of serial ports.
pub fn serial_ports(system: &System) -> Option<Finding> {
    let ports = system.list("dev");
    let mut ports =
        ports.iter().filter(|name| name.starts_with("ttyUSB") || name.starts_with("ttyACM"));
    let why = "a real vehicle is reached through a serial port";
    let closed = ports.clone().find(|port| !system.may_use(&format!("dev/{port}")));
    let finding = |found: String| Finding::ok("serial ports", why, found);
    match (closed, ports.next()) {
        (Some(port), _) => Some(
            finding(format!("/dev/{port} cannot be used by this user"))
                .advise("sudo usermod -aG dialout \"$USER\" # then log in again"),
        ),
        (None, Some(port)) => Some(finding(format!("/dev/{port}"))),
        (None, None) => None,
    }
}
