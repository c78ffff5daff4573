//! Figures of `oqtal latency`, as in its JSON document.

use std::collections::BTreeMap;

use oqtal_control::statistics::median;
use oqtal_observe::latency::{DistributionSummary, RECEIVER};
use serde::Serialize;

use super::bare::Mechanism;
use super::condition::RigCondition;
use super::pairs::Pair;
use super::rig::Bare;
use oqtal_observe::kernel::ThreadScheduling;
use oqtal_observe::loop_monitor::{LoopCounters, LoopMonitor};

/// The hops without computation: their latency is that of the bus.
pub const TRANSPORT: [&str; 2] = ["publish_to_daemon", "command_to_vehicle"];

/// The hop of the receiver of real cameras.
pub const RECEIVE_TO_PUBLISH: &str = RECEIVER[1];

/// Latency of a hop divided by that of the bare iceoryx2 listener.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Ratio {
    /// Ratio of the medians \[-\].
    pub p50: f64,
    /// Ratio of the 99th percentiles \[-\].
    pub p99: f64,
}

impl Ratio {
    /// Ratio of `ours` to `theirs`.
    pub fn of(ours: &DistributionSummary, theirs: &DistributionSummary) -> Self {
        let over = |ours: u64, theirs: u64| ours as f64 / theirs.max(1) as f64;
        Self { p50: over(ours.p50_ns, theirs.p50_ns), p99: over(ours.p99_ns, theirs.p99_ns) }
    }
}

/// Wake-up lateness.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Wakeup {
    /// Lateness of the daemon after the publication of a pose, or after its deadline.
    pub daemon: DistributionSummary,
    /// Lateness of a process that only sleeps until an instant.
    pub sleep: Option<DistributionSummary>,
    /// Lateness of such a process and of cyclictest, measured simultaneously; empty if cyclictest is not installed.
    pub pairs: Vec<Pair>,
    /// Median of the pairs' ratios.
    pub median_ratio: Option<f64>,
}

/// The hops under one condition.
#[derive(Clone, Debug, Serialize)]
pub struct ConditionFigures {
    /// Name of the condition.
    pub condition: &'static str,
    /// Latency of every hop, and their sum.
    pub hops: BTreeMap<&'static str, DistributionSummary>,
    /// Each hop of [`TRANSPORT`] over the bare listener of iceoryx2, measured under the same condition.
    pub ratio: BTreeMap<&'static str, Ratio>,
}

impl ConditionFigures {
    /// The figures measured under `condition`.
    pub fn of(condition: RigCondition, figures: &LatencyFigures) -> Self {
        Self {
            condition: condition.name(),
            hops: figures.hops.clone(),
            ratio: figures.ratio.clone(),
        }
    }
}

/// The figures of `oqtal latency`, the document of `--json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LatencyFigures {
    /// Latency of every hop, and their sum.
    pub hops: BTreeMap<&'static str, DistributionSummary>,
    /// Latency of each mechanism without the bus.
    pub bare: BTreeMap<&'static str, DistributionSummary>,
    /// Each hop of [`TRANSPORT`] over the bare listener of iceoryx2, and the receiver's hop over a bare UDP socket.
    pub ratio: BTreeMap<&'static str, Ratio>,
    /// The same ratios under each condition; empty for a running instance.
    pub conditions: Vec<ConditionFigures>,
    /// Wake-ups.
    pub wakeup: Wakeup,
    /// Scheduling of the daemon.
    pub realtime: ThreadScheduling,
    /// Counters of the loop.
    pub counters: LoopCounters,
    /// Time from the begin of the measurement to the last tick \[s\].
    pub measured_s: f64,
    /// Why the measurement ended early; `None` if it did not.
    pub ended: Option<String>,
}

impl LatencyFigures {
    /// The figures of the observed loop and of the bare mechanisms.
    pub fn new(monitor: &LoopMonitor, bare: Option<&Bare>, realtime: ThreadScheduling) -> Self {
        let measured = bare.into_iter().flat_map(|bare| &bare.mechanisms);
        let mut figures = Self {
            hops: monitor.hops().iter().map(|(name, hop)| (name, hop.summary())).collect(),
            bare: measured.map(|(name, spans)| (*name, spans.summary())).collect(),
            ratio: BTreeMap::new(),
            conditions: Vec::new(),
            wakeup: Wakeup {
                daemon: monitor.wakeup_lateness().summary(),
                sleep: bare.map(|bare| bare.sleep.summary()),
                ..Wakeup::default()
            },
            realtime,
            counters: monitor.counters(),
            measured_s: 0.0,
            ended: None,
        };
        figures.ratio = figures.ratios(Mechanism::Iceoryx2Listener);
        figures.ratio.extend(figures.receiver_ratio().map(|ratio| (RECEIVE_TO_PUBLISH, ratio)));
        figures
    }

    /// Hop of the receiver of real cameras over a bare UDP socket; `None` if one of the two was not measured.
    fn receiver_ratio(&self) -> Option<Ratio> {
        let measured = |summary: &&DistributionSummary| summary.count > 0;
        let hop = self.hops.get(RECEIVE_TO_PUBLISH).filter(measured)?;
        let bare = self.bare.get(Mechanism::UdpSocket.name()).filter(measured)?;
        Some(Ratio::of(hop, bare))
    }

    /// Hops of [`TRANSPORT`] over `mechanism`; none if one of the two was not measured.
    pub fn ratios(&self, mechanism: Mechanism) -> BTreeMap<&'static str, Ratio> {
        let measured = |summary: &&DistributionSummary| summary.count > 0;
        let Some(bare) = self.bare.get(mechanism.name()).filter(measured) else {
            return BTreeMap::new();
        };
        let hops = TRANSPORT.into_iter().filter_map(|name| {
            let hop = self.hops.get(name).filter(measured)?;
            Some((name, Ratio::of(hop, bare)))
        });
        hops.collect()
    }

    /// Adds the comparison with cyclictest.
    pub fn with_pairs(mut self, pairs: Vec<Pair>) -> Self {
        self.wakeup.median_ratio = median(pairs.iter().map(|pair| pair.ratio));
        self.wakeup.pairs = pairs;
        self
    }

    /// As one JSON document.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("figures hold only what JSON can say")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(p50_ns: u64, p99_ns: u64) -> DistributionSummary {
        DistributionSummary { count: 10, p50_ns, p99_ns, ..DistributionSummary::default() }
    }

    #[test]
    fn a_hop_is_compared_only_with_what_was_measured() {
        let mut figures = LatencyFigures::default();
        figures.hops.insert("publish_to_daemon", summary(40, 90));
        figures.hops.insert("command_to_vehicle", DistributionSummary::default());
        figures.hops.insert("compute", summary(5, 6));
        assert!(figures.ratios(Mechanism::Futex).is_empty());
        figures.bare.insert("futex", summary(20, 100));
        let ratios = figures.ratios(Mechanism::Futex);
        assert_eq!(ratios.keys().collect::<Vec<_>>(), [&"publish_to_daemon"]);
        assert!((ratios["publish_to_daemon"].p50 - 2.0).abs() < 1e-12);
        assert!((ratios["publish_to_daemon"].p99 - 0.9).abs() < 1e-12);
    }

    #[test]
    fn the_median_of_pairs_is_that_of_their_ratios() {
        let pair = |ratio| Pair { ours_p999_ns: 1, cyclictest_p999_ns: 1, ratio };
        let median = |ratios: &[f64]| {
            let pairs = ratios.iter().copied().map(pair).collect();
            LatencyFigures::default().with_pairs(pairs).wakeup.median_ratio
        };
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }
}
