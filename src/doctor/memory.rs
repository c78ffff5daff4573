//! Checks of shared memory, locked memory and swap.

use oqtal_bus::bus::{FLIGHT_KIB, NEEDED_KIB};
use oqtal_runtime::process::Exit;

use super::finding::Finding;
use super::system::System;

const CAP_IPC_LOCK: u32 = 14;
const MIB: u64 = 1 << 20;
/// Free shared memory below which no flight is possible \[bytes\]: that of one flight, and of one operator's command beside it.
const LEAST_FREE: u64 = (FLIGHT_KIB + NEEDED_KIB) * 1024;
/// Free shared memory sufficient for several instances.
const ENOUGH_FREE: u64 = 128 * MIB;

/// Checks the free shared memory for the topics.
pub fn shared(system: &System) -> Option<Finding> {
    let why = "topics live in /dev/shm; a process that finds no room there for its ports ends with exit code 71";
    let remedy = "sudo mount -o remount,size=512M /dev/shm";
    let Some((total, free)) = system.shared_memory else {
        let missing = Finding::ok("shared memory", why, "no /dev/shm");
        return Some(
            missing.forbid(Exit::System, "sudo mount -t tmpfs -o size=512M tmpfs /dev/shm"),
        );
    };
    let found = format!("{} of {} MiB free", free / MIB, total / MIB);
    let finding = Finding::ok("shared memory", why, found);
    Some(match free {
        0..LEAST_FREE => finding.forbid(Exit::System, remedy),
        LEAST_FREE..ENOUGH_FREE => finding.advise(remedy),
        _ => finding,
    })
}

fn may_lock(system: &System) -> bool {
    system.has_capability(CAP_IPC_LOCK) || system.limit("Max locked memory").is_none()
}

/// Checks whether processes may lock their memory.
pub fn locked(system: &System) -> Option<Finding> {
    let why = "a page that was taken from a process is missing when its loop needs it";
    let finding = |found: String| Finding::ok("locked memory", why, found);
    Some(if may_lock(system) {
        finding("permitted".to_owned())
    } else {
        let limit = system.limit("Max locked memory").unwrap_or(0);
        finding(format!("limited to {} KiB (memlock)", limit / 1024)).advise(
            "echo \"$USER - memlock unlimited\" | sudo tee -a /etc/security/limits.d/oqtal.conf # then log in again",
        )
    })
}

/// Checks whether unlocked memory can be paged out.
pub fn swap(system: &System) -> Option<Finding> {
    let swaps = system.read("proc/swaps")?;
    let why = "memory that is not locked can be paged out to disk while the vehicle flies";
    let areas = swaps.lines().skip(1).count();
    let finding = |found: &str| Finding::ok("swap", why, found);
    Some(match (areas, may_lock(system)) {
        (0, _) => finding("none"),
        (_, true) => finding("on, but memory can be locked"),
        (_, false) => finding("on").advise("sudo swapoff -a"),
    })
}
