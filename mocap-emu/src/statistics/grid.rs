//! Time grid of captures, and the relation between captures and arrivals, from the poses of a moving body.

use std::f64::consts::TAU;

use oqtal_control::statistics::{correlation, median, population_deviation};

use crate::capture::Captures;
use crate::recording::Recording;

/// Least speed at which captures are estimated well enough \[m/s\].
const MOVING_M_S: f64 = 0.3;
/// Least number of intervals for statistics.
const LEAST: usize = 200;
/// Longest interval that is not a gap \[s\].
const LONGEST_S: f64 = 0.05;
/// Greatest excess of the time from capture to arrival over its median \[s\]; poses above it were delayed by a stall and do not
/// count.
const BEHIND_S: f64 = 0.03;
/// Candidate rates of the cameras \[Hz\]: below the lowest, every series of intervals looks like a grid.
const RATES_HZ: std::ops::RangeInclusive<u32> = 90..=400;

/// Captures of a moving body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridStatistics {
    /// Rate of the cameras whose period divides the intervals best \[Hz\].
    pub rate_hz: f64,
    /// Agreement of the intervals with that period: 1 for exact multiples of the period, 0 for random intervals \[-\].
    pub coherence_ratio: f64,
    /// Standard deviation of the intervals between captures \[ms\].
    pub interval_ms: f64,
    /// Correlation of the intervals between captures with those between arrivals \[-\].
    pub correlation_ratio: f64,
    /// Standard deviation of the time from capture to arrival \[ms\].
    pub latency_ms: f64,
}

impl GridStatistics {
    /// Statistics of a recording; `None` if the body moves too little.
    pub fn of(recording: &Recording) -> Option<Self> {
        let Captures { captured_s, speed_m_s } = Captures::of(recording);
        let arrivals: Vec<f64> =
            recording.poses().iter().map(|pose| pose.time_ns as f64 * 1e-9).collect();
        let latencies: Vec<f64> = arrivals.iter().zip(&captured_s).map(|(a, c)| a - c).collect();
        let usual_s = median(latencies.iter().copied())?;
        let counts = |k: &usize| {
            speed_m_s[*k].min(speed_m_s[k - 1]) > MOVING_M_S
                && (arrivals[*k] - arrivals[k - 1]).max(captured_s[*k] - captured_s[k - 1])
                    < LONGEST_S
                && latencies[*k].max(latencies[k - 1]) < usual_s + BEHIND_S
        };
        let counted: Vec<usize> = (1..captured_s.len()).filter(counts).collect();
        let intervals = |times: &[f64]| -> Vec<f64> {
            counted.iter().map(|k| times[*k] - times[k - 1]).collect()
        };
        let (captures, follow) = (intervals(&captured_s), intervals(&arrivals));
        let latencies: Vec<f64> = counted.iter().map(|k| latencies[*k]).collect();
        if captures.len() < LEAST {
            return None;
        }
        let (rate_hz, coherence_ratio) = RATES_HZ
            .map(|rate_hz| (f64::from(rate_hz), coherence(&captures, f64::from(rate_hz))))
            .fold((0.0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
        Some(Self {
            rate_hz,
            coherence_ratio,
            interval_ms: population_deviation(&captures) * 1e3,
            // 0 for cameras whose intervals are constant.
            correlation_ratio: Some(correlation(&captures, &follow))
                .filter(|r| r.is_finite())
                .unwrap_or(0.0),
            latency_ms: population_deviation(&latencies) * 1e3,
        })
    }
}

/// Agreement of `intervals` \[s\] with multiples of a period \[-\]: the length of the mean of their phases as unit vectors.
fn coherence(intervals: &[f64], rate_hz: f64) -> f64 {
    let phases = intervals.iter().map(|interval| (interval * rate_hz * TAU).sin_cos());
    let (y, x) = phases.fold((0.0, 0.0), |sum, (sin, cos)| (sum.0 + sin, sum.1 + cos));
    f64::hypot(x, y) / intervals.len() as f64
}
