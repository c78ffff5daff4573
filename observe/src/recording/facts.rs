//! Facts recorded beside the messages: version, configuration, clocks, machine.

use std::collections::BTreeMap;
use std::fs;

use oqtal_bus::time::Span;
use oqtal_config::Config;

use crate::kernel::ThreadScheduling;
use crate::provenance::Provenance;
use crate::summary::name_of;

/// Version of the layout of recordings: names of channels, metadata and attachments.
pub const LAYOUT: &str = "1";
/// Name of the facts about the recording itself, at the beginning of every file.
pub const RECORDING: &str = "oqtal.recording";
/// Name of the attachment with the effective configuration.
pub const CONFIG_FILE: &str = "config.toml";
/// Name of the attachment with the waypoints of the configuration.
pub const WAYPOINTS_FILE: &str = "waypoints.csv";

/// Stands for the number of a request in the name of the waypoints that a daemon read at its start \[-\].
pub(super) const AT_START: u64 = 0;

/// Name of the attachment with the waypoints that the daemon `source` read for the request `number`, or at its start, [`AT_START`].
pub(super) fn waypoints_of_request(source: u64, number: u64) -> String {
    format!("waypoints-{source:016x}-{number}.csv")
}

/// A named table of facts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Facts {
    /// Name of the table.
    pub name: String,
    /// Facts by name.
    pub entries: BTreeMap<String, String>,
}

impl Facts {
    /// A table of `entries`.
    pub fn new<K: Into<String>>(
        name: &str,
        entries: impl IntoIterator<Item = (K, String)>,
    ) -> Self {
        let entries = entries.into_iter().map(|(key, value)| (key.into(), value)).collect();
        Self { name: name.to_owned(), entries }
    }

    /// Facts at the beginning of every file of a recording. `wall_offset` is added to message instants to obtain the times of the
    /// file.
    pub fn of_recording(config: &Config, provenance: Provenance, wall_offset: Span) -> Self {
        let facts = [
            ("layout", LAYOUT.to_owned()),
            ("version", provenance.version.to_owned()),
            ("revision", provenance.revision.to_owned()),
            ("instance", config.instance.name.clone()),
            ("clock", name_of(&config.clock.kind)),
            ("seed", config.clock.seed.to_string()),
            ("config_hash", format!("{:016x}", config.hash())),
            ("wall_offset_ns", wall_offset.nanos().to_string()),
        ];
        Self::new(RECORDING, facts)
    }

    /// The machine: kernel, processor, memory.
    pub fn of_machine() -> Self {
        let kernel = rustix::system::uname();
        let text = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        let read = |path: &str| fs::read_to_string(path).map(|text| text.trim().to_owned()).ok();
        let value = |path: &str, key: &str| {
            let found = read(path)?;
            let line = found.lines().find_map(|line| line.strip_prefix(key)).map(str::to_owned)?;
            Some(line.trim_start_matches([' ', '\t', ':']).trim().to_owned())
        };
        let processors = std::thread::available_parallelism().map_or(0, |count| count.get());
        let clock_source = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
        let unknown = || "unknown".to_owned();
        let facts = [
            ("kernel", Some(format!("{} {}", text(kernel.sysname()), text(kernel.release())))),
            ("kernel_build", Some(text(kernel.version()))),
            ("architecture", Some(text(kernel.machine()))),
            ("processor", value("/proc/cpuinfo", "model name")),
            ("processors", Some(processors.to_string())),
            ("memory", value("/proc/meminfo", "MemTotal")),
            ("isolated_processors", read("/sys/devices/system/cpu/isolated")),
            ("clock_source", read(clock_source)),
        ];
        Self::new("machine", facts.map(|(name, fact)| (name, fact.unwrap_or_else(unknown))))
    }

    /// Scheduling granted to the daemon by the kernel.
    pub fn of_grants(daemon: &ThreadScheduling) -> Self {
        let cpu = daemon.cpu.map_or_else(|| "any".to_owned(), |cpu| cpu.to_string());
        let facts = [
            ("policy", daemon.policy.clone().into_owned()),
            ("priority", daemon.priority.to_string()),
            ("processor", cpu),
            ("memory_locked", daemon.locked.to_string()),
        ];
        Self::new("granted", facts)
    }
}
