//! What the kernel says of a process: how it is scheduled, what it holds. Read from `/proc`, so it is what is, not what was
//! asked for.

use std::{fmt, fs};

use oqtal_config::{self as config, Scheduling};
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};
use serde::Serialize;

/// How the most urgent thread of a process is scheduled.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ThreadScheduling {
    /// `other`, `fifo`, `rr`, `batch`, `idle` or `deadline`.
    pub policy: &'static str,
    /// Real-time priority; 0 under ordinary scheduling.
    pub priority: u32,
    /// The one processor it may use; `None` if there are several.
    pub cpu: Option<usize>,
    /// Whether its memory cannot be paged out.
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
    /// That of the process `pid`; `None` if there is none.
    #[must_use]
    pub fn of(pid: u64) -> Option<Self> {
        let tasks = fs::read_dir(format!("/proc/{pid}/task")).ok()?;
        let threads = tasks.flatten().filter_map(|task| {
            let read = |name| fs::read_to_string(task.path().join(name)).ok();
            Self::parse(&read("stat")?, &read("status")?)
        });
        threads.max_by_key(|thread| thread.priority)
    }

    /// Real-time settings that were requested but not granted by the kernel.
    #[must_use]
    pub fn missing(&self, requested: &config::Realtime) -> Vec<&'static str> {
        let wanted = [
            ("SCHED_FIFO", requested.scheduling == Scheduling::Fifo, self.policy == "fifo"),
            ("locked memory", requested.lock_memory, self.locked),
        ];
        let missing = wanted.into_iter().filter(|(_, requested, granted)| *requested && !granted);
        missing.map(|(name, ..)| name).collect()
    }

    /// From the `stat` and `status` of a thread, proc(5).
    fn parse(stat: &str, status: &str) -> Option<Self> {
        // The name may hold blanks and brackets; the fields behind it start with the third.
        let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<usize>().ok();
        let line = |key: &str| {
            status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':')).map(str::trim)
        };
        let locked_kb = line("VmLck").and_then(|text| text.split(' ').next());
        Some(Self {
            policy: policy(field(41)?),
            priority: u32::try_from(field(40)?).ok()?,
            cpu: line("Cpus_allowed_list").and_then(|list| list.parse().ok()),
            locked: locked_kb.is_some_and(|kilobytes| kilobytes != "0"),
        })
    }
}

/// sched(7), as numbered in the kernel's `sched.h`.
fn policy(number: usize) -> &'static str {
    ["other", "fifo", "rr", "batch", "iso", "idle", "deadline"].get(number).unwrap_or(&"unknown")
}

/// What a process holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Footprint {
    /// Memory in RAM \[KiB\].
    pub resident_kib: u64,
    /// Open files, sockets included.
    pub open_files: usize,
}

impl Footprint {
    /// That of the process `pid`; `None` if there is none, or it is another user's.
    #[must_use]
    pub fn of(pid: u64) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        Some(Self {
            resident_kib: resident.trim().split(' ').next()?.parse().ok()?,
            open_files: fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count(),
        })
    }
}

/// A process over the time it was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ProcessUsage {
    /// How it was scheduled.
    pub realtime: ThreadScheduling,
    /// What it held when it was first looked at.
    pub start: Footprint,
    /// What it held in the end.
    pub end: Footprint,
}

impl ProcessUsage {
    /// The process `pid`, looked at for the first time.
    #[must_use]
    pub fn of(pid: u64) -> Option<Self> {
        let start = Footprint::of(pid)?;
        Some(Self { realtime: ThreadScheduling::of(pid)?, start, end: start })
    }

    /// Looks again; what is gone stays as it was.
    pub fn update(&mut self, pid: u64) {
        self.end = Footprint::of(pid).unwrap_or(self.end);
    }
}

/// Keeps the calling thread, and whatever it starts, on the processor it runs on; gives it back all it had when it goes out of
/// scope. Processes that take turns, of which one at a time has anything to do, wake each other fastest so: no processor
/// has to be woken first.
#[derive(Debug)]
pub struct OneProcessor(CpuSet);

impl OneProcessor {
    /// `None` where the kernel refuses.
    #[must_use]
    pub fn stay() -> Option<Self> {
        let before = sched_getaffinity(None).ok()?;
        let mut here = CpuSet::new();
        here.set(sched_getcpu());
        sched_setaffinity(None, &here).ok()?;
        Some(Self(before))
    }
}

impl Drop for OneProcessor {
    fn drop(&mut self) {
        // A processor may have gone meanwhile; the thread then stays where it is.
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
            ThreadScheduling { policy: "fifo", priority: 80, cpu: Some(1), locked: true }
        );
        let several =
            ThreadScheduling::parse(&stat, "VmLck:\t0 kB\nCpus_allowed_list:\t0-1\n").unwrap();
        assert_eq!((several.cpu, several.locked), (None, false));
    }

    #[test]
    fn what_is_asked_for_and_not_granted_is_named() {
        let requested = config::Config::default().realtime;
        let granted = ThreadScheduling { policy: "fifo", priority: 50, cpu: None, locked: true };
        assert!(granted.missing(&requested).is_empty());
        assert_eq!(
            ThreadScheduling::default().missing(&requested),
            ["SCHED_FIFO", "locked memory"]
        );
        let content = config::Realtime { lock_memory: false, ..asked };
        assert_eq!(ThreadScheduling::default().lacks(&content), ["SCHED_FIFO"]);
    }

    #[test]
    fn a_thread_stays_on_one_processor_until_it_is_let_go() {
        let before = sched_getaffinity(None).unwrap();
        let stay = OneProcessor::stay().unwrap();
        assert_eq!(sched_getaffinity(None).unwrap().count(), 1);
        drop(stay);
        assert_eq!(sched_getaffinity(None).unwrap(), before);
    }

    #[test]
    fn this_process_is_scheduled_somehow() {
        let own = ThreadScheduling::of(u64::from(std::process::id())).unwrap();
        assert_ne!(own.policy, "unknown");
        assert_eq!(ThreadScheduling::of(u64::MAX), None);
        let held = Footprint::of(u64::from(std::process::id())).unwrap();
        assert!(held.resident_kib > 0 && held.open_files > 2, "{held:?}");
    }
}
