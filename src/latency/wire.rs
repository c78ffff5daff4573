//! `oqtal latency --wire`: from the cameras' datagram to the first command datagram after it, by the kernel's clock: emulated QTM
//! server, receiver, daemon and bridge over MAVLink. Beside it the same by a program in Python, where its packages are
//! installed, and the bare mechanisms of which the chain consists.
//!
//! A command that the daemon sends on its timer counts as the answer to the last frame: after a stall the figure is a lower bound.
//! The chains fly in turn, so that other load affects all of them alike.

mod capture;
mod chains;

use oqtal_config::Config;
use oqtal_observe::latency::{Distribution, DistributionSummary};
use oqtal_observe::plot::unit::significant;
use oqtal_observe::table::{align, latency_row, table};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;
use serde::Serialize;

use super::bare::Mechanism;
use super::figures::Ratio;
use chains::Chain;

/// Times that each chain is measured.
const ROUNDS: u32 = 3;
/// Approximate time for start, take-off and end of a chain \[s\].
const CHAIN_S: f64 = 12.0;
/// Wake-ups of the chain besides that of the receiver: daemon and bridge.
const FUTEXES: u64 = 2;

/// Latency of a chain from datagram to datagram.
#[derive(Clone, Debug, Serialize)]
pub struct WireChain {
    /// Name of the chain.
    pub name: &'static str,
    /// Time from the datagram of the cameras to the first command after it.
    pub latency: DistributionSummary,
    /// Datagrams of the cameras without a command before the next one \[-\].
    pub unanswered: u64,
}

/// The figures of `oqtal latency --wire`, the document of `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct ChainFigures {
    /// The chain of processes, then those in Python that are installed.
    pub chains: Vec<WireChain>,
    /// Sum of the mechanisms alone, percentile by percentile: a UDP datagram to a process that sleeps, and two futexes.
    pub bare: DistributionSummary,
    /// The first chain over the bare mechanisms.
    pub over_bare: Ratio,
    /// The other chains over the first one.
    pub over_first: Vec<Ratio>,
}

impl ChainFigures {
    fn of(chains: Vec<WireChain>, bare: DistributionSummary) -> Self {
        let first = &chains[0].latency;
        Self {
            over_bare: Ratio::of(first, &bare),
            over_first: chains[1..].iter().map(|it| Ratio::of(&it.latency, first)).collect(),
            bare,
            chains,
        }
    }

    /// As one JSON document.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("figures hold only what JSON can say")
    }

    /// As a table, and ratios.
    pub fn text(&self) -> String {
        let mut table = table(&["cameras to command [us]", "p50", "p99", "p99.9", "max"]);
        for chain in &self.chains {
            table.add_row(latency_row(chain.name, &chain.latency));
        }
        table.add_row(latency_row("bare: UDP, two futexes", &self.bare));
        align(&mut table);
        let pair =
            |ratio: &Ratio| format!("{} / {}", significant(ratio.p50), significant(ratio.p99));
        let mut lines = vec![table.to_string()];
        lines.push(format!("oqtal over the bare mechanisms, p50 / p99: {}", pair(&self.over_bare)));
        for (chain, ratio) in self.chains[1..].iter().zip(&self.over_first) {
            lines.push(format!("{} over oqtal, p50 / p99: {}", chain.name, pair(ratio)));
        }
        for WireChain { name, latency, unanswered } in &self.chains {
            let all = latency.count + unanswered;
            lines.push(format!("{name}: {unanswered} of {all} frames without a command"));
        }
        lines.join("\n")
    }
}

/// Measures the chains in turn, each for `seconds` \[s\] in every round; `bare` measures the mechanisms alone.
///
/// # Errors
/// The interface cannot be observed (exit code 77), cameras of another program send over it (75), or a process fails.
pub fn measure(
    config: &Config,
    seconds: u32,
    stop: &StopFlag,
    mut bare: impl FnMut() -> Result<[DistributionSummary; 2], Failure>,
) -> Result<ChainFigures, Failure> {
    let chains = Chain::installed();
    let all_s =
        ROUNDS as f64 * chains.len() as f64 * (f64::from(seconds) + CHAIN_S) + f64::from(seconds);
    say(&format!("this takes about {all_s:.0} s; Ctrl-C ends it early, without figures"));
    let mut measured = vec![(Distribution::default(), 0); chains.len()];
    for round in 1..=ROUNDS {
        for (chain, (latency, unanswered)) in chains.iter().zip(&mut measured) {
            if stop.is_set() {
                let failure =
                    Failure::new(Exit::Flight, "interrupted: the chains were not measured alike");
                return Err(failure);
            }
            say(&format!("{}, {round} of {ROUNDS}: {seconds} s", chain.name()));
            let answers = chain.fly(config, seconds, stop)?;
            answers.latencies.iter().for_each(|span| latency.add(*span));
            *unanswered += answers.unanswered;
        }
    }
    say(&format!("bare mechanisms: {seconds} s"));
    let [udp, futex] = bare()?;
    let chains = chains.iter().zip(measured).map(|(chain, (latency, unanswered))| WireChain {
        name: chain.name(),
        latency: latency.summary(),
        unanswered,
    });
    Ok(ChainFigures::of(chains.collect(), sum(&udp, &futex)))
}

/// Names of the mechanisms in the sum.
pub const BARE_MECHANISMS: [Mechanism; 2] = [Mechanism::UdpSocket, Mechanism::Futex];

fn sum(udp: &DistributionSummary, futex: &DistributionSummary) -> DistributionSummary {
    let sum = |part: fn(&DistributionSummary) -> u64| part(udp) + FUTEXES * part(futex);
    DistributionSummary {
        count: udp.count.min(futex.count),
        min_ns: sum(|it| it.min_ns),
        p50_ns: sum(|it| it.p50_ns),
        p99_ns: sum(|it| it.p99_ns),
        p999_ns: sum(|it| it.p999_ns),
        max_ns: sum(|it| it.max_ns),
    }
}
