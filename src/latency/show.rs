//! The figures as text for the terminal.

use comfy_table::Table;
use oqtal_observe::latency::NAMES;

use super::bare::Mechanism;
use super::figures::{LatencyFigures, RECEIVE_TO_PUBLISH, Ratio, TRANSPORT};
use oqtal_observe::plot::unit::{significant, words};
use oqtal_observe::table::{align, latency_row, table};

/// Tables: hops with bare mechanisms, and their ratios.
pub fn text(figures: &LatencyFigures) -> String {
    let mut parts = vec![
        format!("daemon: {}; measured for {:.1} s", figures.realtime, figures.measured_s),
        latencies(figures).to_string(),
    ];
    parts.extend(receiver(figures));
    parts.extend(ratios(figures).map(|table| table.to_string()));
    parts.extend(conditions(figures).map(|table| table.to_string()));
    parts.extend(pairs(figures));
    parts.push(counts(figures));
    parts.join("\n")
}

fn latencies(figures: &LatencyFigures) -> Table {
    let mut table = table(&["latency [us]", "p50", "p99", "p99.9", "max"]);
    for name in NAMES {
        if let Some(hop) = figures.hops.get(name).filter(|hop| hop.count > 0) {
            table.add_row(latency_row(&words(name), hop));
        }
    }
    table.add_row(latency_row("daemon wake-up", &figures.wakeup.daemon));
    for mechanism in Mechanism::ALL {
        if let Some(bare) = figures.bare.get(mechanism.name()) {
            table.add_row(latency_row(&format!("bare {}", words(mechanism.name())), bare));
        }
    }
    if let Some(sleep) = &figures.wakeup.sleep {
        table.add_row(latency_row("bare sleep, lateness", sleep));
    }
    align(&mut table);
    table
}

/// Hop of the receiver of real cameras over a bare UDP socket.
fn receiver(figures: &LatencyFigures) -> Option<String> {
    let Ratio { p50, p99 } = figures.ratio.get(RECEIVE_TO_PUBLISH)?;
    let (p50, p99) = (significant(*p50), significant(*p99));
    Some(format!("receive to publish over a bare UDP socket, p50 / p99: {p50} / {p99}"))
}

/// Each transport hop over each bare mechanism, p50 and p99.
fn ratios(figures: &LatencyFigures) -> Option<Table> {
    if figures.ratio.is_empty() {
        return None;
    }
    let mut table = table(&["hop over bare, p50 / p99", "publish to daemon", "command to vehicle"]);
    for mechanism in Mechanism::ALL {
        let ratios = figures.ratios(mechanism);
        let cells = TRANSPORT.map(|name| {
            ratios.get(name).map_or_else(String::new, |ratio| {
                format!("{} / {}", significant(ratio.p50), significant(ratio.p99))
            })
        });
        table.add_row(std::iter::once(words(mechanism.name())).chain(cells));
    }
    align(&mut table);
    Some(table)
}

/// Each transport hop over the bare listener of iceoryx2 under each condition, p50 and p99, and the computation.
fn conditions(figures: &LatencyFigures) -> Option<Table> {
    if figures.conditions.is_empty() {
        return None;
    }
    let mut table = table(&[
        "over the iceoryx2 listener, p50 / p99",
        "publish to daemon",
        "command to vehicle",
        "compute p50 [us]",
    ]);
    for condition in &figures.conditions {
        let mut row = vec![condition.condition.to_owned()];
        row.extend(TRANSPORT.map(|name| {
            condition.ratio.get(name).map_or_else(String::new, |ratio| {
                format!("{} / {}", significant(ratio.p50), significant(ratio.p99))
            })
        }));
        let compute = condition.hops.get("compute");
        row.push(compute.map_or_else(String::new, |hop| significant(hop.p50_ns as f64 * 1e-3)));
        table.add_row(row);
    }
    align(&mut table);
    Some(table)
}

fn pairs(figures: &LatencyFigures) -> Option<String> {
    let wakeup = &figures.wakeup;
    let median = wakeup.median_ratio?;
    let ratios: Vec<String> = wakeup.pairs.iter().map(|pair| significant(pair.ratio)).collect();
    Some(format!(
        "periodic wake-up, p99.9 over cyclictest's: median {}, pairs {}",
        significant(median),
        ratios.join(" ")
    ))
}

fn counts(figures: &LatencyFigures) -> String {
    let counters = &figures.counters;
    let unobserved = match counters.unobserved {
        0 => String::new(),
        lost => format!("; {lost} samples were not observed: this machine is overloaded"),
    };
    format!(
        "ticks {}, on a pose {}, deadlines missed {}, poses lost {}, refused {}, commands {}, lost {}{unobserved}",
        counters.ticks,
        counters.fresh_ticks,
        counters.deadline_misses,
        counters.poses_lost,
        counters.poses_refused,
        counters.commands,
        counters.commands_lost
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::latency::condition::RigCondition;
    use crate::latency::figures::ConditionFigures;
    use oqtal_observe::latency::DistributionSummary;

    #[test]
    fn the_table_fits_a_terminal_and_shows_every_hop_and_mechanism() {
        let summary = DistributionSummary {
            count: 600,
            min_ns: 10_000,
            p50_ns: 40_000,
            p99_ns: 90_000,
            p999_ns: 1_000_000,
            max_ns: 4_000_000,
        };
        let mut figures = LatencyFigures::default();
        figures.hops.extend(NAMES.map(|name| (name, summary)));
        figures.bare.extend(Mechanism::ALL.map(|mechanism| (mechanism.name(), summary)));
        figures.ratio = figures.ratios(Mechanism::Iceoryx2Listener);
        figures.wakeup.sleep = Some(summary);
        figures.conditions =
            RigCondition::ALL.map(|condition| ConditionFigures::of(condition, &figures)).to_vec();
        let text = text(&figures);
        assert!(text.lines().all(|line| line.chars().count() <= 110), "{text}");
        for word in [
            "publish to daemon",
            "bare futex",
            "bare iceoryx2 listener",
            "1.00 / 1.00",
            "without warm-up",
        ] {
            assert!(text.contains(word), "{word} in\n{text}");
        }
        assert!(!text.contains("cyclictest"), "{text}");
    }
}
