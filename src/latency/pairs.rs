//! Periodic wake-up compared with cyclictest: same processor, priority and period at the same time, so that other load affects
//! both; their phases are random.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_bus::time::{Span, Time};
use oqtal_observe::latency::Distribution;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::stop::StopFlag;
use rustix::thread::{CpuSet, sched_getaffinity};
use serde::{Deserialize, Serialize};

use super::part;
use super::rig::{Rig, read};
use super::sleep::RECORD;
use crate::child::{Child, command};
use oqtal_observe::kernel::ThreadScheduling;

/// Number of pairs measured.
pub const PAIRS: u32 = 5;
/// Upper end of cyclictest's histogram \[us\].
const LONGEST_US: u64 = 100_000;
const QUANTILE: f64 = 0.999;

/// One simultaneous run of both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// 99.9th percentile of our loop's lateness.
    pub ours_p999_ns: u64,
    /// 99.9th percentile of cyclictest's lateness.
    pub cyclictest_p999_ns: u64,
    /// Ratio of our percentile to cyclictest's \[-\].
    pub ratio: f64,
}

/// Conditions under which both run.
#[derive(Debug)]
struct Terms {
    /// Configuration file of our loop.
    config: PathBuf,
    cpu: usize,
    /// Priority under SCHED_FIFO.
    priority: Option<u32>,
    length: Span,
}

impl Terms {
    fn new(rig: &Rig, length: Span, realtime: &ThreadScheduling) -> Result<Self, Failure> {
        let mut config = rig.config().clone();
        let cpu = config.realtime.cpus.last().copied().map_or_else(last_cpu, Ok)?;
        config.realtime.cpus = vec![cpu];
        let file = rig.directory().join("periodic.toml");
        files::write(&file, config.to_toml())
            .map_err(|e| Failure::new(Exit::System, format!("{}: {e}", file.display())))?;
        let priority = (realtime.policy == "fifo").then_some(realtime.priority);
        Ok(Self { config: file, cpu, priority, length })
    }
}

/// Whether cyclictest is installed.
pub fn is_installed() -> bool {
    succeeds("cyclictest", &["--help"])
}

/// Runs both side by side for `length`, several times, scheduled as `realtime`.
///
/// # Errors
/// One of them cannot be run.
pub fn run(
    rig: &Rig,
    length: Span,
    realtime: &ThreadScheduling,
    stop: &StopFlag,
) -> Result<Vec<Pair>, Failure> {
    let terms = Terms::new(rig, length, realtime)?;
    let mut pairs = Vec::new();
    while pairs.len() < PAIRS as usize && !stop.is_set() {
        pairs.push(pair(rig.directory(), &terms)?);
    }
    Ok(pairs)
}

fn pair(directory: &Path, terms: &Terms) -> Result<Pair, Failure> {
    let report = directory.join("cyclictest.json");
    let ours = command(&[part::COMMAND, "periodic"], &terms.config)?;
    let mut ours = Child::start("periodic", ours, directory)?;
    wait_for_any_phase();
    let from = Time::now();
    let mut theirs = Child::start("cyclictest", cyclictest(&report, terms), directory)?;
    if !theirs.ends_within(terms.length + Span::from_millis(5000)) {
        return Err(Failure::new(Exit::System, "cyclictest did not end when its time was over"));
    }
    if let Some(failure) = ours.failure() {
        return Err(failure);
    }
    let to = Time::now();
    ours.shut_down();
    let ours = whole_micros(read(&directory.join(RECORD), from, to)?.quantile(QUANTILE));
    let text = std::fs::read_to_string(&report).unwrap_or_default();
    let theirs = p999_of(&text).ok_or_else(|| {
        Failure::new(Exit::System, "cyclictest left no histogram; rt-tests 2.0 or newer is needed")
    })?;
    let ratio = ours as f64 / theirs.max(1) as f64;
    Ok(Pair { ours_p999_ns: ours, cyclictest_p999_ns: theirs, ratio })
}

fn cyclictest(report: &Path, terms: &Terms) -> Command {
    let mut command = Command::new("cyclictest");
    let duration = terms.length.to_duration().as_secs().max(1);
    // Without tuning of the machine, like our loop.
    command.args(["--quiet", "--default-system", "--mlockall", "--threads=1", "--interval=1000"]);
    command.arg(format!("--affinity={}", terms.cpu)).arg(format!("--duration={duration}"));
    command.arg(format!("--histogram={LONGEST_US}"));
    match terms.priority {
        Some(priority) => command.arg(format!("--priority={priority}")),
        None => command.arg("--policy=other"),
    };
    command.arg(format!("--json={}", report.display())).stdin(Stdio::null());
    command
}

/// Document that cyclictest writes with `--json`.
#[derive(Deserialize)]
struct Report {
    thread: BTreeMap<String, Thread>,
}

#[derive(Deserialize)]
struct Thread {
    /// Wake-ups by lateness in microseconds.
    histogram: BTreeMap<String, u64>,
    cycles: u64,
}

fn p999_of(report: &str) -> Option<u64> {
    let report: Report = serde_json::from_str(report).ok()?;
    let thread = report.thread.into_values().next()?;
    let mut bins = Vec::new();
    for (micros, count) in &thread.histogram {
        bins.push((micros.parse::<u64>().ok()?, *count));
    }
    let listed: u64 = bins.iter().map(|(_, count)| count).sum();
    bins.push((LONGEST_US, thread.cycles.saturating_sub(listed)));
    bins.sort_unstable();
    let mut distribution = Distribution::default();
    for (micros, count) in bins {
        for _ in 0..count {
            distribution.add(Span::from_nanos((micros * 1000).cast_signed()));
        }
    }
    (distribution.count() > 0).then(|| whole_micros(distribution.quantile(QUANTILE)))
}

/// Whole microseconds of a span, as counted by cyclictest \[ns\].
fn whole_micros(span: Span) -> u64 {
    span.nanos().max(0).unsigned_abs() / 1000 * 1000
}

/// Sleeps for a random part of 10 ms, so that the phase between the two loops is random.
fn wait_for_any_phase() {
    let random = fnv1a(FNV_OFFSET, &Time::now().nanos().to_le_bytes());
    std::thread::sleep(Duration::from_nanos(random % 10_000_000));
}

/// Last processor available to this process; the first one serves most interrupts.
fn last_cpu() -> Result<usize, Failure> {
    let allowed = sched_getaffinity(None)
        .map_err(|e| Failure::new(Exit::System, format!("asking for processors failed: {e}")))?;
    Ok((0..CpuSet::MAX_CPU).rev().find(|cpu| allowed.is_set(*cpu)).unwrap_or(0))
}

fn succeeds(program: &str, words: &[&str]) -> bool {
    let mut command = Command::new(program);
    command.args(words).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_histogram_of_cyclictest_is_read_with_what_lies_beyond_it() {
        let report = |cycles: u64| {
            format!(
                r#"{{"file_version": 1, "thread": {{"0": {{"histogram": {{"7": 900, "12": 99, "40": 1}},
                "cycles": {cycles}, "min": 7, "max": 40, "avg": 7.5, "cpu": 1, "node": 0}}}}}}"#
            )
        };
        assert_eq!(p999_of(&report(1000)), Some(12_000));
        // Ten further wake-ups, not listed in the histogram, were later than its end.
        assert!(p999_of(&report(1010)).unwrap() >= 100_000_000);
        assert_eq!(p999_of("{}"), None);
    }
}
