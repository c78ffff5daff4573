//! The lower envelope of one-way delays: the line below all (stamp, arrival) pairs of a sliding window.
//!
//! Arrival = stamp + offset + drift × stamp + delay, and no delay is negative. Of all lines below the pairs, the one with the
//! least mean distance to them touches the pairs with the shortest delay; a mean or a regression would follow the delays. That
//! line is the edge of the lower convex hull at the middle of the window. Its slope is bounded, so that it is also usable while
//! the window is short.

use std::collections::VecDeque;

/// Length of the window \[ns\]. Longer averages more; the drift of quartz clocks is constant for far longer.
const WINDOW_NS: f64 = 20e9;
/// One pair is kept of each interval of this length \[ns\], the one with the least delay, which bounds work and memory.
const INTERVAL_NS: f64 = 100e6;
/// Most pairs kept \[-\].
const CAPACITY: usize = (WINDOW_NS / INTERVAL_NS) as usize + 2;
/// Greatest slope \[-\]: twice what the quartzes of two machines differ by at worst.
pub const MAX_DRIFT: f64 = 200e-6;

/// One pair. Both numbers are relative to the first pair, so that they are exact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StampPair {
    /// Stamp of the server \[ns, server clock\].
    pub stamp_ns: f64,
    /// Arrival minus stamp \[ns\].
    pub offset_ns: f64,
}

/// The line below the pairs: `offset_ns + drift * (stamp - stamp_ns)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnvelopeLine {
    /// A point of the line.
    anchor: StampPair,
    /// Slope: drift of this machine's clock against the server's \[-\].
    pub drift: f64,
}

impl EnvelopeLine {
    /// Arrival minus stamp of a frame without any delay beyond the least one \[ns\].
    pub fn offset_ns(&self, stamp_ns: f64) -> f64 {
        self.anchor.offset_ns + self.drift * (stamp_ns - self.anchor.stamp_ns)
    }
}

/// The least delay of one interval.
#[derive(Clone, Copy, Debug)]
struct Interval {
    index: i64,
    least: StampPair,
    /// Pairs in the interval \[-\].
    count: u32,
    /// Sum of their offsets \[ns\].
    sum_ns: f64,
}

/// The envelope of the pairs of the last seconds. Work and memory are bounded; nothing is allocated after `new`.
#[derive(Clone, Debug)]
pub struct LowerEnvelope {
    intervals: VecDeque<Interval>,
    hull: Vec<StampPair>,
    line: EnvelopeLine,
}

impl Default for LowerEnvelope {
    fn default() -> Self {
        Self {
            intervals: VecDeque::with_capacity(CAPACITY),
            hull: Vec::with_capacity(CAPACITY),
            line: EnvelopeLine::default(),
        }
    }
}

impl LowerEnvelope {
    /// Discards all pairs.
    pub fn clear(&mut self) {
        self.intervals.clear();
        self.line = EnvelopeLine::default();
    }

    /// Discards the pairs up to this stamp \[ns, server clock\], and those of the same interval; the last interval is kept.
    pub fn forget_through(&mut self, stamp_ns: f64) {
        let index = (stamp_ns / INTERVAL_NS).floor() as i64;
        while self.intervals.len() > 1
            && self.intervals.front().is_some_and(|first| first.index <= index)
        {
            self.intervals.pop_front();
        }
        self.fit();
    }

    /// The line below the pairs; meaningless before the first one.
    pub fn line(&self) -> EnvelopeLine {
        self.line
    }

    /// Adds a pair, whose stamp is not before the last one's, and fits the line.
    pub fn add(&mut self, pair: StampPair) {
        let index = (pair.stamp_ns / INTERVAL_NS).floor() as i64;
        match self.intervals.back_mut().filter(|last| last.index == index) {
            Some(last) => {
                if self.line.drift.mul_add(last.least.stamp_ns - pair.stamp_ns, pair.offset_ns)
                    < last.least.offset_ns
                {
                    last.least = pair;
                }
                last.count += 1;
                last.sum_ns += pair.offset_ns;
            }
            None => {
                let sum_ns = pair.offset_ns;
                self.intervals.push_back(Interval { index, least: pair, count: 1, sum_ns });
            }
        }
        while self.intervals.front().is_some_and(|first| {
            pair.stamp_ns - first.least.stamp_ns > WINDOW_NS || self.intervals.len() >= CAPACITY
        }) {
            self.intervals.pop_front();
        }
        self.fit();
    }

    /// Number of pairs in the window \[-\].
    pub fn count(&self) -> u32 {
        self.intervals.iter().map(|interval| interval.count).sum()
    }

    /// Mean distance of the pairs from the line \[ns\].
    pub fn mean_delay_ns(&self) -> f64 {
        let above = |interval: &Interval| {
            let on_line = self.line.offset_ns(interval.least.stamp_ns);
            interval.sum_ns - f64::from(interval.count) * on_line
        };
        let sum: f64 = self.intervals.iter().map(above).sum();
        (sum / f64::from(self.count().max(1))).max(0.0)
    }

    fn fit(&mut self) {
        let (Some(first), Some(last)) = (self.intervals.front(), self.intervals.back()) else {
            return;
        };
        let middle = 0.5 * (first.least.stamp_ns + last.least.stamp_ns);
        self.hull.clear();
        for interval in &self.intervals {
            while let [.., a, b] = self.hull[..]
                && !turns_up(a, b, interval.least)
            {
                self.hull.pop();
            }
            self.hull.push(interval.least);
        }
        let edge = self.hull.windows(2).find(|edge| edge[1].stamp_ns >= middle);
        let drift = edge.map_or(0.0, |edge| slope(edge[0], edge[1]));
        let drift = drift.clamp(-MAX_DRIFT, MAX_DRIFT);
        // A clamped slope may cut the hull: the line is lowered to the pair that it touches.
        let height = |pair: &StampPair| pair.offset_ns - drift * pair.stamp_ns;
        let touched = self.hull.iter().min_by(|a, b| height(a).total_cmp(&height(b)));
        if let Some(&anchor) = touched {
            self.line = EnvelopeLine { anchor, drift };
        }
    }
}

fn slope(a: StampPair, b: StampPair) -> f64 {
    (b.offset_ns - a.offset_ns) / (b.stamp_ns - a.stamp_ns).max(1.0)
}

/// Whether the line from `a` over `b` to `c` turns upward at `b`.
fn turns_up(a: StampPair, b: StampPair, c: StampPair) -> bool {
    slope(a, b) < slope(b, c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_touches_the_fastest_pairs_and_is_below_all_others() {
        let mut envelope = LowerEnvelope::default();
        let pairs: Vec<StampPair> = (0..1200)
            .map(|k| {
                let stamp_ns = f64::from(k) * 16e6;
                let delay_ns = f64::from((k * 7919) % 101) * 50e3;
                StampPair { stamp_ns, offset_ns: 1e5 + 30e-6 * stamp_ns + delay_ns }
            })
            .collect();
        for pair in &pairs {
            envelope.add(*pair);
        }
        let line = envelope.line();
        for pair in &pairs {
            assert!(line.offset_ns(pair.stamp_ns) <= pair.offset_ns + 1.0);
        }
        assert!((line.drift - 30e-6).abs() < 1e-6, "{}", line.drift);
        let truth = 1e5 + 30e-6 * 19e9;
        assert!((line.offset_ns(19e9) - truth).abs() < 10e3, "{}", line.offset_ns(19e9) - truth);
        assert!((envelope.mean_delay_ns() / 2.5e6 - 1.0).abs() < 0.05);
    }

    #[test]
    fn old_pairs_leave_the_window_and_memory_is_bounded() {
        let mut envelope = LowerEnvelope::default();
        for k in 0..100_000 {
            envelope.add(StampPair { stamp_ns: f64::from(k) * 5e6, offset_ns: 0.0 });
        }
        assert!(envelope.count() <= 4040 && envelope.intervals.len() < CAPACITY);
        assert_eq!(envelope.intervals.capacity(), CAPACITY);
    }
}
