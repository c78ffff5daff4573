//! Section of a replay: arrivals of its poses.

use maud::{Markup, html};
use oqtal_bus::time::Time;
use oqtal_control::statistics::{median, population_deviation, quantile};

use crate::flight::Flight;

use super::events::list;
use super::timeline::Timeline;
use crate::page::section;
use crate::plot::axis::Axis;
use crate::plot::chart::{Mark, Plot};
use crate::plot::figure::{FULL, figure, histogram};
use crate::plot::palette::Ink;
use crate::plot::unit::significant;

/// Interval between two poses above which it counts as a gap \[ms\].
const GAP_MS: f64 = 50.0;
/// Number of bars of the histogram.
const BARS: usize = 100;

/// The interval between two successive poses.
struct PoseInterval {
    from: Time,
    length_ms: f64,
    frames_lost: u64,
}

/// The intervals between the poses of a recording.
pub struct ArrivalIntervals {
    intervals: Vec<PoseInterval>,
    /// Number of poses \[-\].
    pub poses: usize,
}

impl ArrivalIntervals {
    /// The intervals of `flight`.
    pub fn of(flight: &Flight) -> Self {
        // A frame in which the cameras did not see the body is a lost one.
        let poses: Vec<_> = flight.arrivals.iter().filter(|pose| pose.is_tracked).collect();
        let pairs = poses.windows(2);
        let intervals = pairs.map(|pair| PoseInterval {
            from: pair[0].at,
            length_ms: pair[1].at.since(pair[0].at).seconds() * 1e3,
            frames_lost: pair[1].frame.saturating_sub(pair[0].frame).saturating_sub(1),
        });
        Self { intervals: intervals.collect(), poses: poses.len() }
    }

    /// Number of frames without a pose.
    pub fn frames_lost(&self) -> u64 {
        self.intervals.iter().fold(0, |sum, interval| sum.saturating_add(interval.frames_lost))
    }

    /// Median interval \[ms\]; NaN without intervals.
    pub fn median_ms(&self) -> f64 {
        median(self.lengths_ms()).unwrap_or(f64::NAN)
    }

    /// Standard deviation of the intervals without gaps \[ms\]; NaN without intervals.
    pub fn jitter_ms(&self) -> f64 {
        let regular: Vec<f64> = self.lengths_ms().filter(|length| *length <= GAP_MS).collect();
        population_deviation(&regular)
    }

    /// Maximum interval \[ms\]; NaN without intervals.
    pub fn longest_ms(&self) -> f64 {
        self.lengths_ms().fold(f64::NAN, f64::max)
    }

    /// Mean rate from the first to the last pose \[Hz\]; NaN without intervals.
    pub fn mean_hz(&self) -> f64 {
        self.intervals.len() as f64 / (self.lengths_ms().sum::<f64>() * 1e-3)
    }

    /// Interval not exceeded by the fraction `share` of the intervals \[ms\]; NaN without intervals.
    fn quantile_ms(&self, share: f64) -> f64 {
        quantile(self.lengths_ms(), share).unwrap_or(f64::NAN)
    }

    /// Number of gaps and their total time \[s\].
    fn gaps(&self) -> (usize, f64) {
        let gaps: Vec<f64> = self.lengths_ms().filter(|length| *length > GAP_MS).collect();
        (gaps.len(), gaps.iter().sum::<f64>() * 1e-3)
    }

    fn lengths_ms(&self) -> impl Iterator<Item = f64> {
        self.intervals.iter().map(|interval| interval.length_ms)
    }
}

/// The section of arrivals.
pub fn replay(timeline: &Timeline<'_>, arrivals: &ArrivalIntervals) -> Markup {
    let gaps = arrivals.intervals.iter().filter(|interval| interval.length_ms > GAP_MS);
    let what = |gap: &PoseInterval| {
        format!("{} ms, frames lost: {}", significant(gap.length_ms), gap.frames_lost)
    };
    section(
        "Arrival of poses",
        html! {
            div.wide { (intervals(arrivals)) }
            (table(arrivals))
            (list(gaps.map(|gap| (timeline.seconds(gap.from), what(gap)))))
        },
    )
}

/// A time \[ms\] as text; less than a microsecond is a rounding error.
pub fn milliseconds(value: f64) -> String {
    if value < 1e-3 { "0 ms".to_owned() } else { format!("{} ms", significant(value)) }
}

/// The figures of the arrivals: rate, gaps, jitter.
fn table(arrivals: &ArrivalIntervals) -> Markup {
    let (gaps, in_gaps_s) = arrivals.gaps();
    let frames = arrivals.poses as u64 + arrivals.frames_lost();
    let share = 100.0 * arrivals.frames_lost() as f64 / frames.max(1) as f64;
    let rows = [
        ("Poses", arrivals.poses.to_string()),
        ("Mean rate", format!("{} Hz", significant(arrivals.mean_hz()))),
        ("Rate by the median interval", format!("{} Hz", significant(1e3 / arrivals.median_ms()))),
        ("Interval, median", milliseconds(arrivals.median_ms())),
        ("Interval, p99", milliseconds(arrivals.quantile_ms(0.99))),
        ("Interval, longest", milliseconds(arrivals.longest_ms())),
        ("Jitter, rms, gaps left out", milliseconds(arrivals.jitter_ms())),
        ("Frames lost", format!("{} ({} %)", arrivals.frames_lost(), significant(share))),
        ("Gaps over 50 ms", format!("{gaps}, {} s in all", significant(in_gaps_s))),
    ];
    html! {
        div.wide.scroll {
            table.facts { tbody { @for (name, value) in rows { tr { th { (name) } td { (value) } } } } }
        }
    }
}

/// Histogram of the intervals, up to a gap or three times the median.
fn intervals(arrivals: &ArrivalIntervals) -> Markup {
    let longest = GAP_MS.max(3.0 * arrivals.median_ms());
    let range = 0.0..longest;
    let counts = histogram(arrivals.lengths_ms(), &range, BARS);
    let greatest = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let width = longest / BARS as f64;
    let bar = |(i, count): (usize, &u64)| {
        let from = i as f64 * width;
        // The base of a bar is at half a count, so that a single one is visible.
        let (floor, top) = (0.5_f64.log10(), (*count as f64).log10());
        Mark::Block(Ink::Actual, (from, floor), (from + 0.85 * width, top))
    };
    let mut y = Axis::decades(0.0..greatest.log10(), |decade| {
        10_u64.pow(decade.unsigned_abs()).to_string()
    });
    y.range.start = 0.5_f64.log10();
    let plot = Plot {
        size: (FULL, 480),
        label_width: 120,
        x: Axis::linear(range, 10.0, " ms"),
        y,
        shapes: counts.iter().enumerate().filter(|(_, count)| **count > 0).map(bar).collect(),
    };
    figure("Number of intervals between two poses, by length", &[], &plot)
}
