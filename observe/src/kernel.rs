//! Scheduling and resource use of a process as the kernel reports them in `/proc`.

use std::borrow::Cow;
use std::{fmt, fs};

use oqtal_config::{self as config, Scheduling};
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};
use serde::{Deserialize, Serialize};

/// Scheduling of the thread with the highest priority of a process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ThreadScheduling {
    /// `other`, `fifo`, `rr`, `batch`, `idle` or `deadline`.
    pub policy: Cow<'static, str>,
    /// Real-time priority; 0 under ordinary scheduling.
    pub priority: u32,
    /// Processor to which the thread is bound; `None` if it may use several.
    pub cpu: Option<usize>,
    /// Whether the memory of the process is locked.
    pub locked: bool,
}

impl fmt::Display for ThreadScheduling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SCHED_{}", self.policy.to_uppercase())?;
        if self.priority > 0 {
            write!(f, ", priority {}", self.priority)?;
        }
        match self.cpu {
            Some(cpu) => write!(f, ", processor {cpu}")?,
            None => write!(f, ", any processor")?,
        }
        write!(f, ", memory {}", if self.locked { "locked" } else { "not locked" })
    }
}

impl ThreadScheduling {
    /// Reads the scheduling of the process `pid`; `None` if it does not exist.
    pub fn of(pid: u32) -> Option<Self> {
        let tasks = fs::read_dir(format!("/proc/{pid}/task")).ok()?;
        let threads = tasks.flatten().filter_map(|task| {
            let read = |name| fs::read_to_string(task.path().join(name)).ok();
            Self::parse(&read("stat")?, &read("status")?)
        });
        threads.max_by_key(|thread| thread.priority)
    }

    /// Real-time settings that were requested but not granted by the kernel.
    pub fn missing(&self, requested: &config::RealtimeOptions) -> Vec<&'static str> {
        let wanted = [
            ("SCHED_FIFO", requested.scheduling == Scheduling::Fifo, self.policy == "fifo"),
            ("locked memory", requested.lock_memory, self.locked),
        ];
        let missing = wanted.into_iter().filter(|(_, requested, granted)| *requested && !granted);
        missing.map(|(name, ..)| name).collect()
    }

    /// Parses the files `stat` and `status` of a thread, proc(5).
    fn parse(stat: &str, status: &str) -> Option<Self> {
        // The name may contain blanks and brackets; the first field after the name is number three.
        let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<usize>().ok();
        let line = |key: &str| {
            status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':')).map(str::trim)
        };
        let locked_kb = line("VmLck").and_then(|text| text.split(' ').next());
        Some(Self {
            policy: policy(field(41)?).into(),
            priority: u32::try_from(field(40)?).ok()?,
            cpu: line("Cpus_allowed_list").and_then(|list| list.parse().ok()),
            locked: locked_kb.is_some_and(|kilobytes| kilobytes != "0"),
        })
    }
}

/// Name of a scheduling policy, sched(7), by its number in the kernel's `sched.h`.
fn policy(number: usize) -> &'static str {
    ["other", "fifo", "rr", "batch", "iso", "idle", "deadline"].get(number).unwrap_or(&"unknown")
}

/// Resources held by a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Footprint {
    /// Resident memory \[KiB\].
    pub resident_kib: u64,
    /// Open files, sockets included \[-\].
    pub open_files: usize,
}

impl Footprint {
    /// Reads the resources of the process `pid`; `None` if it does not exist or belongs to another user.
    pub fn of(pid: u32) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        Some(Self {
            resident_kib: resident.trim().split(' ').next()?.parse().ok()?,
            open_files: fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count(),
        })
    }
}

/// Scheduling and resource use of a process over a flight.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProcessUsage {
    /// Scheduling at the start.
    pub realtime: ThreadScheduling,
    /// Resources at the start.
    pub start: Footprint,
    /// Resources at the end.
    pub end: Footprint,
}

impl fmt::Display for ProcessUsage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { realtime, start, end } = self;
        write!(
            f,
            "{realtime}; resident {} KiB at the start, {} at the end; open files {}, {}",
            start.resident_kib, end.resident_kib, start.open_files, end.open_files
        )
    }
}

impl ProcessUsage {
    /// Reads the process `pid` at the start; `None` if it does not exist.
    pub fn of(pid: u32) -> Option<Self> {
        let start = Footprint::of(pid)?;
        Some(Self { realtime: ThreadScheduling::of(pid)?, start, end: start })
    }

    /// Reads the resources at the end; keeps the last ones if the process is gone.
    pub fn update(&mut self, pid: u32) {
        self.end = Footprint::of(pid).unwrap_or(self.end);
    }
}

/// Binds the calling thread, and the processes that it starts, to its present processor; restores the affinity on drop. Processes
/// that run in turns, as in lockstep, wake each other fastest on one processor, since no other processor must leave its idle
/// state.
#[derive(Debug)]
pub struct OneProcessor(CpuSet);

impl OneProcessor {
    /// Binds the thread; `None` if the kernel refuses.
    pub fn bind() -> Option<Self> {
        let before = sched_getaffinity(None).ok()?;
        let mut here = CpuSet::new();
        here.set(sched_getcpu());
        sched_setaffinity(None, &here).ok()?;
        Some(Self(before))
    }
}

impl Drop for OneProcessor {
    fn drop(&mut self) {
        // Fails if a processor went offline in the meantime; the thread then stays bound.
        let _ = sched_setaffinity(None, &self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fields_of_proc_are_found_behind_any_name() {
        let mut fields: Vec<String> = (3..=52).map(|number| number.to_string()).collect();
        fields[40 - 3] = "80".to_owned();
        fields[41 - 3] = "1".to_owned();
        let stat = format!("17 (a) b (c) {}", fields.join(" "));
        let status = "Name:\tx\nVmLck:\t  5120 kB\nCpus_allowed_list:\t1\n";
        let found = ThreadScheduling::parse(&stat, status).unwrap();
        assert_eq!(
            found,
            ThreadScheduling { policy: "fifo".into(), priority: 80, cpu: Some(1), locked: true }
        );
        let several =
            ThreadScheduling::parse(&stat, "VmLck:\t0 kB\nCpus_allowed_list:\t0-1\n").unwrap();
        assert_eq!((several.cpu, several.locked), (None, false));
    }

    #[test]
    fn requested_settings_that_were_not_granted_are_listed() {
        let requested = config::Config::default().realtime;
        let granted =
            ThreadScheduling { policy: "fifo".into(), priority: 50, cpu: None, locked: true };
        assert!(granted.missing(&requested).is_empty());
        assert_eq!(
            ThreadScheduling::default().missing(&requested),
            ["SCHED_FIFO", "locked memory"]
        );
        let content = config::RealtimeOptions { lock_memory: false, ..requested };
        assert_eq!(ThreadScheduling::default().missing(&content), ["SCHED_FIFO"]);
    }

    #[test]
    fn a_thread_stays_on_one_processor_until_it_is_released() {
        let before = sched_getaffinity(None).unwrap();
        let stay = OneProcessor::bind().unwrap();
        assert_eq!(sched_getaffinity(None).unwrap().count(), 1);
        drop(stay);
        assert_eq!(sched_getaffinity(None).unwrap(), before);
    }

    #[test]
    fn scheduling_and_resources_of_this_process_are_read() {
        let own = ThreadScheduling::of(std::process::id()).unwrap();
        assert_ne!(own.policy, "unknown");
        assert_eq!(ThreadScheduling::of(u32::MAX), None);
        let held = Footprint::of(std::process::id()).unwrap();
        assert!(held.resident_kib > 0 && held.open_files > 2, "{held:?}");
    }
}
