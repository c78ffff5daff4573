//! Statistics of a recording, for the comparison of an emulated room with real ones: arrivals, captures, gaps, noise at rest.

mod grid;
mod rest;

use oqtal_control::statistics::population_deviation;

use crate::recording::Recording;
pub use grid::GridStatistics;
pub use rest::{RestStatistics, allan_deviation};

/// Upper ends of the classes of intervals between arrivals \[ms\].
pub const CLASSES_MS: [f64; 5] = [5.0, 15.0, 25.0, 35.0, 50.0];

/// Lengths above which gaps are counted \[ms\].
pub const GAPS_MS: [f64; 3] = [50.0, 80.0, 250.0];

/// Statistics of one recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomStatistics {
    /// Mean rate of arrivals \[Hz\].
    pub rate_hz: f64,
    /// Standard deviation of the intervals between arrivals, without gaps above the first of [`GAPS_MS`] \[ms\].
    pub interval_ms: f64,
    /// Share of the intervals in each of [`CLASSES_MS`] \[percent\].
    pub shares_percent: [f64; 5],
    /// Intervals per 1000 s longer than each of [`GAPS_MS`] \[-\].
    pub gaps: [f64; 3],
    /// Statistics of captures, where the body moves.
    pub grid: Option<GridStatistics>,
    /// Statistics of noise, where the body is at rest.
    pub rest: Option<RestStatistics>,
}

impl RoomStatistics {
    /// Statistics of `recording`.
    pub fn of(recording: &Recording) -> Self {
        let poses = recording.poses();
        let intervals: Vec<f64> = poses
            .windows(2)
            .map(|pair| (pair[1].time_ns - pair[0].time_ns) as f64 * 1e-6)
            .collect();
        let share = |from: f64, to: f64| {
            let count = intervals.iter().filter(|ms| (from..to).contains(*ms)).count();
            100.0 * count as f64 / intervals.len() as f64
        };
        let mut from = 0.0;
        let shares_percent = CLASSES_MS.map(|to| share(std::mem::replace(&mut from, to), to));
        let timing = recording.timing();
        let per_1000_s = 1e12 / timing.duration_ns as f64;
        let usual: Vec<f64> = intervals.iter().copied().filter(|ms| *ms <= GAPS_MS[0]).collect();
        Self {
            rate_hz: timing.mean_rate_hz,
            interval_ms: population_deviation(&usual),
            shares_percent,
            gaps: GAPS_MS.map(|least| {
                intervals.iter().filter(|ms| **ms > least).count() as f64 * per_1000_s
            }),
            grid: GridStatistics::of(recording),
            rest: RestStatistics::of(recording),
        }
    }
}
