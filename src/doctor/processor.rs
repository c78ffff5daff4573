//! Checks of number, clock source, frequency and idle states of the processors.

use super::finding::Finding;
use super::system::System;

const CPUS: &str = "sys/devices/system/cpu";
const CLOCKS: &str = "sys/devices/system/clocksource/clocksource0";
/// Clock sources that are read without a system call.
const FAST_CLOCKS: [&str; 4] =
    ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"];
/// Exit latency of an idle state above which the latency of the loop suffers \[us\].
const SLOW_WAKE_US: u64 = 50;

/// Number of processors in a kernel list such as `0-3,8`.
fn count(list: &str) -> usize {
    let ranges = list.split(',').filter(|range| !range.is_empty());
    let lengths = ranges.map(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let number = |text: &str| text.trim().parse::<usize>().unwrap_or(0);
        (number(last) + 1).saturating_sub(number(first))
    });
    lengths.sum()
}

/// Checks the number of processors and reports the isolated ones.
pub fn number(system: &System) -> Option<Finding> {
    let online = count(&system.read(&format!("{CPUS}/online"))?);
    let isolated = system.read(&format!("{CPUS}/isolated")).filter(|list| !list.is_empty());
    let kept = isolated.as_deref().map_or_else(
        || "none isolated".to_owned(),
        |list| format!("isolated {list}: name them in realtime.cpus"),
    );
    let why = "the chain shares its only processor with everything else";
    let finding = Finding::ok("processors", why, format!("{online}, {kept}"));
    Some(if online < 2 { finding.note() } else { finding })
}

/// Checks whether the governor lowers the frequency while a loop sleeps.
pub fn governor(system: &System) -> Option<Finding> {
    let cpus = system.list(CPUS);
    let mut governors: Vec<String> = cpus
        .iter()
        .filter_map(|cpu| system.read(&format!("{CPUS}/{cpu}/cpufreq/scaling_governor")))
        .collect();
    governors.sort();
    governors.dedup();
    let why = "a processor that slowed down while the loop slept computes the next command slowly";
    let finding = |found: &str| Finding::ok("frequency governor", why, found);
    Some(match governors.as_slice() {
        [] => finding("none: this kernel does not change frequencies"),
        [only] if only == "performance" => finding(only),
        some => finding(&some.join(", ")).advise(
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
    })
}

/// Checks the exit latency of the deepest idle state.
pub fn idle_states(system: &System) -> Option<Finding> {
    let states = format!("{CPUS}/cpu0/cpuidle");
    let enabled =
        |state: &String| system.read(&format!("{states}/{state}/disable")).as_deref() != Some("1");
    let deepest = system
        .list(&states)
        .iter()
        .filter(|state| state.starts_with("state"))
        .filter(|state| enabled(state))
        .filter_map(|state| {
            let latency = system.read(&format!("{states}/{state}/latency"))?.parse::<u64>().ok()?;
            Some((latency, system.read(&format!("{states}/{state}/name")).unwrap_or_default()))
        })
        .max();
    let why = "between two poses processors fall asleep; from a deep sleep they wake late";
    let finding = |found: String| Finding::ok("idle states", why, found);
    Some(match deepest {
        None => finding("none: this kernel has no deep sleep".to_owned()),
        Some((latency, name)) if latency > SLOW_WAKE_US => finding(format!(
            "down to {name}, {latency} us to wake"
        ))
        .advise(format!(
            "sudo cpupower idle-set -D {SLOW_WAKE_US} # package linux-cpupower; until the next boot"
        )),
        Some((latency, name)) => finding(format!("down to {name}, {latency} us to wake")),
    })
}

/// Checks whether the clock is read without a system call.
pub fn clock_source(system: &System) -> Option<Finding> {
    let current = system.read(&format!("{CLOCKS}/current_clocksource"))?;
    let why = "every stamp reads the clock; with this source each read is a system call";
    let finding = Finding::ok("clock source", why, current.clone());
    if FAST_CLOCKS.contains(&current.as_str()) {
        return Some(finding);
    }
    let available = system.read(&format!("{CLOCKS}/available_clocksource")).unwrap_or_default();
    let better = available.split_whitespace().find(|name| FAST_CLOCKS.contains(name));
    Some(match better {
        Some(name) => {
            finding.advise(format!("echo {name} | sudo tee /{CLOCKS}/current_clocksource"))
        }
        None => finding.note(),
    })
}

/// Checks whether this is a virtual machine.
pub fn hypervisor(system: &System) -> Option<Finding> {
    let flags = system.value("proc/cpuinfo", "flags")?;
    let why = "the host can stop all processors for milliseconds, unseen; latencies here are good for ratios in one run, not for limits";
    let virtual_machine = flags.split_whitespace().any(|flag| flag == "hypervisor");
    Some(if virtual_machine {
        Finding::ok("hypervisor", why, "a virtual machine").note()
    } else {
        Finding::ok("hypervisor", why, "none")
    })
}
