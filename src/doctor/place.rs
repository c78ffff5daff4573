//! Checks of the files of instances, files left by killed processes, and serial ports.

use std::collections::BTreeSet;

use oqtal_bus::paths::InstancePaths;
use oqtal_runtime::process::Exit;

use super::finding::Finding;
use super::system::System;

/// Checks whether instances can be created.
pub fn root(system: &System) -> Option<Finding> {
    let directory = system.instances.display();
    let why = "processes find each other by files there, and all of them must run as one user";
    let finding = |found: String| Finding::ok("instances", why, found);
    Some(if system.instances_writable {
        finding(format!("in {directory}"))
    } else {
        finding(format!("{directory} cannot be written by this user"))
            .forbid(Exit::Permission, format!("sudo install -d -o \"$USER\" {directory}"))
    })
}

/// Checks for instances in shared memory without a running process.
pub fn remains(system: &System) -> Option<Finding> {
    let files = system.list("dev/shm");
    let held = mapped(system);
    let dead: BTreeSet<&str> = files
        .iter()
        .filter_map(|file| instance_of(system, file))
        .filter(|instance| !held.contains(*instance))
        .collect();
    let why =
        "a killed process frees no shared memory; the next of its instance does, others never";
    let finding = |found: String| Finding::ok("remains of dead instances", why, found);
    Some(match dead.first() {
        None => finding("none".to_owned()),
        Some(first) => {
            let all: Vec<&str> = dead.iter().copied().collect();
            finding(all.join(", ")).advise(format!(
                "oqtal ctl status --root {} --instance {first} # joins and tidies up",
                system.instances.display()
            ))
        }
    })
}

/// Instance with this root to which a file in shared memory belongs.
fn instance_of<'a>(system: &System, file: &'a str) -> Option<&'a str> {
    let (instance, _) = file.strip_prefix("oqtal_")?.split_once('_')?;
    let place = InstancePaths::new(instance, Some(&system.instances)).ok()?;
    file.starts_with(&place.prefix()).then_some(instance)
}

/// Instances whose shared memory is mapped by a process.
fn mapped(system: &System) -> BTreeSet<String> {
    let mut held = BTreeSet::new();
    let processes = system.list("proc");
    for pid in processes.iter().filter(|name| name.bytes().all(|digit| digit.is_ascii_digit())) {
        let maps = system.read(&format!("proc/{pid}/maps")).unwrap_or_default();
        let files = maps.lines().filter_map(|line| line.split("/dev/shm/").nth(1));
        held.extend(files.filter_map(|file| instance_of(system, file)).map(str::to_owned));
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
