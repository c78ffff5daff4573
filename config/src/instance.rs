//! `[instance]`, `[clock]` and `[log]`: testbed, time base, and log lines.

use serde::{Deserialize, Serialize};

/// `[instance]`: a testbed on this machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct InstanceOptions {
    /// Name, `[a-z0-9-]{1,32}`.
    pub name: String,
    /// Directory of the instance's files; empty for the default rule of `oqtal_bus::paths::InstancePaths`.
    pub root: String,
}

/// Clock of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ClockKind {
    /// The machine's boot-time clock.
    Real,
    /// Virtual time, the same processes.
    Lockstep,
    /// Virtual time, one process.
    InProcess,
}

impl ClockKind {
    /// Name of the clock in a configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Lockstep => "lockstep",
            Self::InProcess => "in-process",
        }
    }
}

/// `[clock]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ClockOptions {
    /// Kind of clock.
    pub kind: ClockKind,
    /// Seed of every random source.
    pub seed: u64,
}

/// `[log]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct LogOptions {
    /// Least severe level that is written.
    pub level: LogLevel,
}

/// Severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum LogLevel {
    Error,
    Warn,
    Info,
    Debug,
    Trace,
}
