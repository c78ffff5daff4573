//! Resources of the processes: names in shared memory, open files, memory. Their use must not grow.

/// Number of flights until the processes have reached their full size.
const GROWING: u64 = 6;
/// Growth of a process's memory after these flights that does not count as a leak \[KiB\].
const GROWTH_KIB: u64 = 2048;
/// Additional names in shared memory after these flights, of recently replaced peers \[-\].
const GROWTH_OBJECTS: usize = 12;
/// Additional open files of a process after these flights, of recently replaced peers \[-\].
const GROWTH_FILES: usize = 8;

/// Number of names in shared memory, and of each process open files and resident memory \[KiB\].
#[derive(Clone, Debug, Default)]
pub struct Resources {
    pub shared: usize,
    pub processes: Vec<(usize, u64)>,
}

/// Open files and resident memory \[KiB\] of a process.
pub fn usage(pid: u32) -> (usize, u64) {
    let files = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count();
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    (files, line.trim().trim_end_matches(" kB").parse().unwrap())
}

/// Greatest use in the first flights, and latest use.
#[derive(Debug, Default)]
pub struct ResourceRecord {
    greatest: Resources,
    latest: Resources,
}

impl ResourceRecord {
    /// Adds the use before the flight with this number; it must not exceed the use in the first flights.
    pub fn add(&mut self, now: Resources, flight: u64) {
        let Self { greatest, latest } = self;
        if flight < GROWING {
            greatest.shared = greatest.shared.max(now.shared);
            greatest.processes.resize(now.processes.len(), (0, 0));
            for (greatest, now) in greatest.processes.iter_mut().zip(&now.processes) {
                *greatest = (greatest.0.max(now.0), greatest.1.max(now.1));
            }
        } else {
            let objects = now.shared <= greatest.shared + GROWTH_OBJECTS;
            assert!(objects, "shared memory: {greatest:?}, now {now:?}");
            for (greatest_of, now_of) in greatest.processes.iter().zip(&now.processes) {
                let files = now_of.0 <= greatest_of.0 + GROWTH_FILES;
                assert!(files, "open files: {greatest:?}, now {now:?}");
                let memory = now_of.1 <= greatest_of.1 + GROWTH_KIB;
                assert!(memory, "memory: {greatest:?}, now {now:?}");
            }
        }
        *latest = now;
    }
}
