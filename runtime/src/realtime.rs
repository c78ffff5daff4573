//! Real-time settings of a loop: scheduling, processors, locked memory, timer slack. A setting refused by the operating system is
//! reported with its remedy, and the loop runs without it.

use std::hint::black_box;

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity,
    set_current_timer_slack,
};
use serde::Serialize;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use oqtal_bus::topic::Role;
use oqtal_config::{RealtimeOptions, Scheduling};

/// Size of the prefaulted stack \[bytes\].
const STACK: usize = 256 * 1024;
/// RLIMIT_RTTIME of a loop under SCHED_FIFO \[us\]: the kernel ends a loop that has not slept for this time (SIGXCPU), so that it
/// cannot block its processor.
const MAX_TURN_US: u64 = 500_000;

/// Real-time settings in force on the calling thread.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GrantedSettings {
    /// `fifo` or `other`.
    pub policy: &'static str,
    /// Priority under SCHED_FIFO; 0 under another policy.
    pub priority: u8,
    /// CPU to which the thread is bound; `None` if it is not bound.
    pub cpu: Option<usize>,
    /// Whether all memory stays in RAM.
    pub locked: bool,
    /// Settings that were requested and refused, each with its remedy.
    #[serde(skip)]
    pub refused: Vec<String>,
}

/// Priority of the loop of `role` under SCHED_FIFO, in order of urgency: safety of a real vehicle, its commands, its poses,
/// simulation. `daemon` is `realtime.priority`.
pub const fn priority_of(role: Role, daemon: u8) -> u8 {
    match role {
        Role::Bridge => daemon.saturating_add(1),
        Role::Daemon => daemon,
        Role::Mocap | Role::Receiver => daemon.saturating_sub(1),
        Role::Plant | Role::Recorder => daemon.saturating_sub(2),
    }
}

/// Applies `options` to the calling thread, the loop of `role`; memory is locked for the whole process.
pub fn enter(options: &RealtimeOptions, role: Role) -> GrantedSettings {
    let mut granted = GrantedSettings { policy: "other", ..GrantedSettings::default() };
    let mut note = |result: Result<(), String>| match result {
        Ok(()) => true,
        Err(refusal) => {
            granted.refused.push(refusal);
            false
        }
    };
    note(bind(&options.cpus));
    note(sharpen(options.timer_slack_us));
    let locked = options.lock_memory && note(lock_memory());
    note(match options.scheduling {
        Scheduling::Fifo => fifo(priority_of(role, options.priority)),
        Scheduling::Other => other(),
    });
    granted.locked = locked;
    if let Some(priority) = fifo_priority() {
        (granted.policy, granted.priority) = ("fifo", priority);
    }
    granted.cpu = bound_to();
    granted
}

fn bind(cpus: &[usize]) -> Result<(), String> {
    if cpus.is_empty() {
        return Ok(());
    }
    let mut set = CpuSet::new();
    cpus.iter().for_each(|&cpu| set.set(cpu));
    sched_setaffinity(None, &set).map_err(|error| {
        format!("not bound to CPUs {cpus:?} ({error}): name CPUs that exist in `realtime.cpus`")
    })
}

fn bound_to() -> Option<usize> {
    let set = sched_getaffinity(None).ok()?;
    (set.count() == 1).then(|| (0..CpuSet::MAX_CPU).find(|&cpu| set.is_set(cpu)))?
}

fn sharpen(slack_us: f64) -> Result<(), String> {
    // At least 1 ns: 0 means the default of 50 us.
    let slack_ns = (slack_us * 1e3).max(1.0) as u64;
    set_current_timer_slack(std::num::NonZeroU64::new(slack_ns))
        .map_err(|error| format!("timer slack not set ({error})"))
}

fn lock_memory() -> Result<(), String> {
    // With a limit, the lock could succeed now and an allocation fail in flight.
    let limit = getrlimit(Resource::Memlock).current;
    let privileged =
        capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if let (Some(bytes), false) = (limit, privileged) {
        return Err(format!(
            "memory not locked (limit {} KiB): raise it to unlimited, `LimitMEMLOCK=infinity` in the unit or `memlock` in \
             /etc/security/limits.d",
            bytes / 1024
        ));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|error| format!("memory not locked ({error})"))?;
    prefault_stack();
    Ok(())
}

/// Touches the stack below the present frame, so that its pages are mapped.
#[inline(never)]
fn prefault_stack() {
    black_box(&mut [0_u8; STACK]);
}

fn fifo(priority: u8) -> Result<(), String> {
    let allowed = getrlimit(Resource::Rttime).maximum.unwrap_or(u64::MAX);
    let longest = Some(MAX_TURN_US.min(allowed));
    setrlimit(Resource::Rttime, Rlimit { current: longest, maximum: longest }).map_err(
        |error| {
            format!("no SCHED_FIFO, since its turns could not be limited (RLIMIT_RTTIME: {error})")
        },
    )?;
    let has = fifo_priority();
    if has == Some(priority) {
        // Set by the unit that started the process; setting it again may be forbidden.
        return Ok(());
    }
    let os_priority = ThreadPriority::Crossplatform(
        priority.try_into().map_err(|reason| format!("priority {priority}: {reason}"))?,
    );
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), os_priority, policy).map_err(|error| {
        let reason = match error {
            thread_priority::Error::OS(code) => Errno::from_raw_os_error(code).to_string(),
            other => format!("{other:?}"),
        };
        if let Some(has) = has {
            return format!(
                "priority {priority} not set ({reason}), {has} stays: `CPUSchedulingPriority={priority}` in the unit"
            );
        }
        format!(
            "no SCHED_FIFO ({reason}): give the process CAP_SYS_NICE or `LimitRTPRIO={priority}`, as root in the unit, or \
             `rtprio {priority}` in /etc/security/limits.d; or set `realtime.scheduling = \"other\"`"
        )
    })
}

/// Ordinary scheduling. A real-time policy set by the unit is kept: changing it may be forbidden.
fn other() -> Result<(), String> {
    match fifo_priority() {
        None => Ok(()),
        Some(_) => Err("SCHED_FIFO stays: `CPUSchedulingPolicy=other` in the unit".to_owned()),
    }
}

/// Priority of the calling thread under SCHED_FIFO; `None` under another policy.
fn fifo_priority() -> Option<u8> {
    parse_fifo_priority(&std::fs::read_to_string("/proc/thread-self/stat").ok()?)
}

/// Parses the `stat` file of a thread, proc(5). The name may contain blanks and brackets; the fields after the name start with
/// number three.
fn parse_fifo_priority(stat: &str) -> Option<u8> {
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(40 - 3);
    let (priority, policy) = (fields.next()?, fields.next()?);
    (policy == "1").then(|| priority.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Format of Linux 6.18, under `chrt -f 7`, with another name.
    const FIFO: &str = "310 (a (b) c) R 1 310 310 0 -1 4194304 97 0 0 0 0 0 0 0 -8 0 1 0 2395413 6201344 460 \
                        18446744073709551615 1 1 0 0 0 0 0 0 0 0 0 0 17 1 7 1 0 0 0 0 0 0 0 0 0 0 0";

    #[test]
    fn urgent_roles_have_the_higher_priority() {
        let order = [Role::Plant, Role::Mocap, Role::Daemon, Role::Bridge];
        let priorities = order.map(|role| priority_of(role, 50));
        assert_eq!(priorities, [48, 49, 50, 51]);
    }

    #[test]
    fn the_scheduling_of_a_thread_is_read_behind_its_name() {
        assert_eq!(parse_fifo_priority(FIFO), Some(7));
        assert_eq!(parse_fifo_priority(&FIFO.replace("17 1 7 1 0", "17 1 0 0 0")), None);
        assert_eq!(parse_fifo_priority("310 (oqtal) R 1"), None);
    }
}
