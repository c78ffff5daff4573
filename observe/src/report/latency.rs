//! The section of latencies, from capture to effect on the vehicle.

use std::ops::Range;

use crate::latency::{ANSWER, Distribution, DistributionSummary, NAMES, RECEIVER, WHOLE};
use maud::{Markup, html};
use oqtal_config::ClockKind;

use crate::flight::Flight;
use crate::summary::Summary;
use crate::wire::WireFigures;

use crate::page::section;
use crate::plot::axis::{Axis, extent};
use crate::plot::chart::{Mark, Plot};
use crate::plot::figure::{HALF, figure, histogram};
use crate::plot::palette::Ink;
use crate::plot::trace::Point;
use crate::plot::unit::{span, words};

/// Colours of [`NAMES`].
const INKS: [Ink; NAMES.len()] = [
    Ink::Actual,
    Ink::Actual,
    Ink::Actual,
    Ink::Second,
    Ink::Third,
    Ink::Third,
    Ink::Fourth,
    Ink::Fifth,
    Ink::Sixth,
    Ink::Fifth,
    Ink::Reference,
];
/// Number of quantiles with which a distribution is drawn.
const QUANTILES: u32 = 400;
/// Number of bars of a histogram per decade.
const BARS_PER_DECADE: usize = 30;
const HEIGHT: u32 = 620;

/// A distribution with its name and colour.
struct Hop<'a> {
    name: String,
    ink: Ink,
    distribution: &'a Distribution,
}

/// The section of the latencies.
pub fn latency(flight: &Flight, summary: &Summary) -> Markup {
    let hops: Vec<Hop<'_>> = flight
        .hops
        .iter()
        .map(|(name, distribution)| Hop { name: words(name), ink: ink(name), distribution })
        .collect();
    let any = hops.iter().any(|hop| hop.distribution.count() > 0);
    section(
        "Latency",
        html! {
            @if flight.config.clock.kind != ClockKind::Real {
                p.note.wide { "Virtual time: these are the latencies of the models; computation and bus take none, and wake-up lateness and period jitter have no meaning." }
            }
            @if any {
                (budget(summary))
                (histograms(&hops))
                (percentiles(&hops))
                @if let Some(figures) = &summary.wire { (wire(figures)) }
            } @else {
                p.note.wide { "No command reached a vehicle that was armed." }
            }
            (table(summary))
        },
    )
}

/// The colour of a hop.
fn ink(name: &str) -> Ink {
    let known = NAMES.iter().zip(INKS).find(|(known, _)| **known == name);
    known.map_or(Ink::Reference, |(_, ink)| ink)
}

/// The figures of the wire.
fn wire(figures: &WireFigures) -> Markup {
    html! { @if let Some(text) = figures.usage() { p.note.wide { "The wire: " (text) "." } } }
}

/// Medians of the hops as one bar.
fn budget(summary: &Summary) -> Markup {
    let hops: Vec<&str> = whole_hops(summary).collect();
    let median = |name: &str| summary.hops.get(name).map_or(0, |hop| hop.p50_ns);
    let total: u64 = hops.iter().map(|name| median(name)).sum();
    let share = |name: &str| 100.0 * median(name) as f64 / total.max(1) as f64;
    html! {
        figure.wide {
            figcaption { span.title { "Median of each hop" } }
            div.budget {
                @for name in hops.iter().filter(|name| median(name) > 0) {
                    div style={ "width:" (format!("{:.3}", share(name))) "%;background:" (ink(name).css()) } {}
                }
            }
            ul.hops {
                @for name in &hops {
                    li {
                        i style={ "background:" (ink(name).css()) } {}
                        (words(name)) " " b { (span(median(name))) }
                    }
                }
                li.whole { (words(WHOLE)) " " b { (span(median(WHOLE))) } }
            }
        }
    }
}

/// Hops that add up to the whole: parts of a hop are in it already.
fn whole_hops(summary: &Summary) -> impl Iterator<Item = &'static str> {
    let is_part = |name: &str| RECEIVER.contains(&name) || name == ANSWER;
    let parts = NAMES.into_iter().filter(move |name| *name != WHOLE && !is_part(name));
    parts.filter(|name| summary.hops.contains_key(name))
}

/// Histograms of the hops, one row each, over one logarithmic axis.
fn histograms(hops: &[Hop<'_>]) -> Markup {
    let quantile = |i: u32| (f64::from(i) + 0.5) / f64::from(QUANTILES);
    let values: Vec<Vec<f64>> = hops
        .iter()
        .map(|hop| (0..QUANTILES).map(|i| decades_of(hop.distribution, quantile(i))).collect())
        .collect();
    let x = time_axis(extent(values.iter().flatten().copied()));
    let bins = BARS_PER_DECADE * (x.range.end - x.range.start) as usize;
    let bars = hops.iter().zip(&values).enumerate().flat_map(|(row, (hop, values))| {
        let counts = histogram(values.iter().copied(), &x.range, bins);
        bars(hop.ink, &counts, &x.range, (hops.len() - 1 - row) as f64)
    });
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: 300,
        shapes: bars.collect(),
        y: Axis::rows(hops.iter().map(|hop| hop.name.as_str())),
        x,
    };
    figure("How often each latency occurs", &[], &plot)
}

/// Bars on the line `floor`; the highest has 0.85 of a row's height.
fn bars(ink: Ink, counts: &[u64], range: &Range<f64>, floor: f64) -> Vec<Mark> {
    let highest = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let width = (range.end - range.start) / counts.len() as f64;
    let bar = |(i, count): (usize, &u64)| {
        let from = range.start + i as f64 * width;
        Mark::Block(ink, (from, floor), (from + width, floor + 0.85 * *count as f64 / highest))
    };
    counts.iter().enumerate().filter(|(_, count)| **count > 0).map(bar).collect()
}

/// Latency over percentile, both logarithmic: each decade to the right is a tenth of the remaining samples.
fn percentiles(hops: &[Hop<'_>]) -> Markup {
    let count = hops.iter().map(|hop| hop.distribution.count()).max().unwrap_or(0);
    let x = Axis::decades(0.0..(count.max(10) as f64).log10(), percentile);
    let steps = (20.0 * x.range.end) as u32;
    let curve = |hop: &Hop<'_>| -> Vec<Point> {
        let nines = (0..=steps).map(|i| f64::from(i) / 20.0);
        nines
            .map(|nines| (nines, decades_of(hop.distribution, 1.0 - 10_f64.powf(-nines))))
            .collect()
    };
    let curves: Vec<Vec<Point>> = hops.iter().map(curve).collect();
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: 120,
        y: time_axis(extent(curves.iter().flatten().map(|point| point.1))),
        shapes: hops.iter().zip(curves).map(|(hop, curve)| Mark::Line(hop.ink, 4, curve)).collect(),
        x,
    };
    figure("Latency by percentile, colours as above", &[], &plot)
}

/// Decimal logarithm of a quantile in nanoseconds; negative infinity for zero, which is not drawn.
fn decades_of(distribution: &Distribution, quantile: f64) -> f64 {
    (distribution.quantile(quantile).nanos() as f64).log10()
}

fn time_axis(range: Range<f64>) -> Axis {
    Axis::decades(range, power_of_ten)
}

/// The label of a power of ten in nanoseconds.
fn power_of_ten(decade: i32) -> String {
    let unit = ["ns", "µs", "ms"].get((decade / 3).unsigned_abs() as usize);
    match unit {
        Some(unit) => format!("{} {unit}", 10_u32.pow(decade.unsigned_abs() % 3)),
        None => format!("{} s", 10_u64.pow(decade.unsigned_abs() - 9)),
    }
}

/// Percentile with this number of nines.
fn percentile(nines: i32) -> String {
    match nines {
        ..=0 => "0 %".to_owned(),
        1 => "90 %".to_owned(),
        _ => format!("{:.*} %", nines as usize - 2, 100.0 - 100.0 * 0.1_f64.powi(nines)),
    }
}

fn table(summary: &Summary) -> Markup {
    let hops = NAMES.into_iter().filter_map(|name| Some((words(name), summary.hops.get(name)?)));
    // In virtual time, computation and bus have no latency.
    let hops = hops.filter(|(_, hop)| hop.count > 0 && hop.max_ns > 0);
    let of_loop =
        [("wake-up lateness", &summary.wakeup_lateness), ("period jitter", &summary.period_jitter)];
    let of_loop =
        of_loop.into_iter().filter_map(|(name, spans)| Some((name.to_owned(), spans.as_ref()?)));
    let of_loop = of_loop.filter(|(_, spans)| spans.count > 0);
    let at_last_byte = summary.wire.as_ref().map(|wire| &wire.command_age);
    let ages = at_last_byte.into_iter().flat_map(|age| {
        [("capture", &age.from_capture), ("publication", &age.from_publication)]
            .map(|(since, age)| (format!("at the last byte on the wire, since {since}"), age))
    });
    html! {
        div.wide.scroll {
            table {
                thead { tr {
                    th { "Hop" }
                    @for heading in ["count", "min", "p50", "p99", "p99.9", "max"] { th { (heading) } }
                } }
                tbody {
                    @for (name, hop) in hops.chain(ages).chain(of_loop) { (row(&name, hop)) }
                }
            }
        }
    }
}

fn row(name: &str, hop: &DistributionSummary) -> Markup {
    let spans = [hop.min_ns, hop.p50_ns, hop.p99_ns, hop.p999_ns, hop.max_ns];
    html! {
        tr {
            th { (name) }
            td { (hop.count) }
            @for nanos in spans { td { (span(nanos)) } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::latency::HOPS;
    use crate::report::tests::fixture;
    use oqtal_bus::time::Span;

    #[test]
    fn the_answer_of_an_external_law_is_a_part_of_the_computation_in_the_bar() {
        let mut flight = fixture::square();
        flight.hops.add_answer(Span::from_millis(2));
        let summary = Summary::of(&flight);
        assert!(summary.hops.contains_key(ANSWER));
        assert_eq!(whole_hops(&summary).collect::<Vec<_>>(), HOPS);
    }
}
