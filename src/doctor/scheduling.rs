//! Checks of permissions, preemption and throttling of real-time threads.

use super::finding::Finding;
use super::system::System;

const CAP_SYS_NICE: u32 = 23;
/// Highest priority of a loop.
const PRIORITY: u64 = 80;
/// Run time per second for real-time threads below which the loop suffers \[us\].
const LEAST_RUNTIME_US: i64 = 500_000;

/// Checks whether loops may run under SCHED_FIFO.
pub fn permission(system: &System) -> Option<Finding> {
    let why = "under ordinary scheduling any other program can delay the loop by milliseconds; it flies nevertheless";
    let finding = |found: String| Finding::ok("real-time priority", why, found);
    if system.has_capability(CAP_SYS_NICE) {
        return Some(finding("permitted by CAP_SYS_NICE".to_owned()));
    }
    Some(match system.limit("Max realtime priority") {
        Some(limit) if limit < PRIORITY => finding(format!("limited to {limit} (rtprio)")).advise(
            "echo \"$USER - rtprio 80\" | sudo tee -a /etc/security/limits.d/oqtal.conf # then log in again",
        ),
        _ => finding("permitted by limit (rtprio)".to_owned()),
    })
}

/// Checks whether the kernel throttles real-time threads.
pub fn throttling(system: &System) -> Option<Finding> {
    let runtime: i64 = system.read("proc/sys/kernel/sched_rt_runtime_us")?.parse().ok()?;
    let why =
        "real-time threads that have had their share of a second stand still until it is over";
    let found = match runtime {
        -1 => "none".to_owned(),
        micros => format!("after {} ms of a second", micros / 1000),
    };
    let finding = Finding::ok("real-time throttling", why, found);
    Some(if (0..LEAST_RUNTIME_US).contains(&runtime) {
        finding.advise("sudo sysctl kernel.sched_rt_runtime_us=950000")
    } else {
        finding
    })
}

/// Checks whether a woken loop may preempt the kernel.
pub fn preemption(system: &System) -> Option<Finding> {
    let why =
        "while the kernel works for another program and cannot be preempted, a woken loop waits";
    let finding = |found: &str| Finding::ok("preemption", why, found);
    if system.read("sys/kernel/realtime").as_deref() == Some("1") {
        return Some(finding("PREEMPT_RT"));
    }
    let version = system.read("proc/version")?;
    if version.contains("PREEMPT_DYNAMIC") {
        // The active mode is in brackets; only root may read it.
        let mode = system.read("sys/kernel/debug/sched/preempt");
        let chosen = mode.as_deref().and_then(|modes| modes.split(['(', ')']).nth(1));
        let asked = system.read("proc/cmdline").is_some_and(|line| line.contains("preempt=full"));
        let full = chosen.map_or(asked, |mode| mode == "full");
        let found =
            format!("dynamic, {}", chosen.unwrap_or(if full { "full" } else { "mode unknown" }));
        let dynamic = finding(&found);
        return Some(if full {
            dynamic
        } else {
            dynamic.advise(
                "mountpoint -q /sys/kernel/debug || sudo mount -t debugfs none /sys/kernel/debug; echo full | \
                 sudo tee /sys/kernel/debug/sched/preempt # or boot with preempt=full",
            )
        });
    }
    if version.contains("PREEMPT") {
        return Some(finding("full"));
    }
    let found = "none, or at chosen points only; a kernel with PREEMPT_RT has it everywhere";
    Some(match realtime_package(system) {
        Some(package) => {
            finding(found).advise(format!("sudo apt install {package} # then boot this kernel"))
        }
        None => finding(found).note(),
    })
}

/// Debian's package of a kernel with PREEMPT_RT for this processor; `None` on another distribution.
fn realtime_package(system: &System) -> Option<&'static str> {
    let is_debian = system.read("etc/os-release")?.lines().any(|line| line == "ID=debian");
    match std::env::consts::ARCH {
        "x86_64" if is_debian => Some("linux-image-rt-amd64"),
        "aarch64" if is_debian => Some("linux-image-rt-arm64"),
        _ => None,
    }
}
