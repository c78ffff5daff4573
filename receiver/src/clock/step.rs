//! Detection of steps back of a server's clock, as opposed to longer delays.
//!
//! Both a step back of the clock and a slower network lengthen the delays of all frames by the same amount, permanently. The
//! stamps distinguish them: a clock that is set back brings the stamps of two frames closer together than any before; a slower
//! network does not change the stamps. A step back therefore is a *contraction* of stamps, followed by a rise of the delays by at
//! least the same amount. A single wrong stamp or a frame without delay ends the hypothesis.

use oqtal_bus::time::{Span, Time};

/// Intervals between stamps that a contraction is measured against \[-\].
const INTERVALS: usize = 32;
/// Least number of intervals that say something \[-\].
const LEAST_INTERVALS: usize = 8;
/// Least contraction that counts \[ns\]: stamps scatter, too.
const LEAST_CONTRACTION_NS: i64 = 1_000_000;
/// Least increase of every delay after a step, as a part of the contraction \[-\]; the rest is error of the line.
const LEAST_RISE: f64 = 0.75;

/// Hypothesis of a step back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepHypothesis {
    /// Arrival of the first frame behind it.
    pub since: Time,
    /// Greatest stamp then: no later stamp is from before it \[ns, server clock\].
    pub stamp_ns: u64,
    /// Frames since \[-\].
    pub frames: u32,
    /// Contraction: the step at least \[ns\].
    pub contraction_ns: i64,
}

impl StepHypothesis {
    /// Whether it has lasted for `time` and `frames` \[-\].
    pub fn has_lasted(&self, now: Time, time: Span, frames: u32) -> bool {
        now.since(self.since) >= time && self.frames >= frames
    }
}

/// Watch for steps back. Bounded work and memory; nothing is allocated.
#[derive(Clone, Debug, Default)]
pub struct StepWatch {
    /// The last intervals between stamps \[ns\].
    intervals: [i64; INTERVALS],
    /// Intervals so far \[-\].
    count: usize,
    /// Stamp of the last frame \[ns, server clock\].
    last_ns: Option<u64>,
    hypothesis: Option<StepHypothesis>,
}

impl StepWatch {
    /// Takes a frame with its stamp \[ns, server clock\] and its delay behind the line \[ns\]. Returns the hypothesis of a step.
    pub fn observe(
        &mut self,
        stamp_ns: u64,
        arrival: Time,
        delay_ns: f64,
    ) -> Option<StepHypothesis> {
        let last_ns = self.last_ns.replace(stamp_ns);
        let interval = last_ns.map(|last| stamp_ns.wrapping_sub(last).cast_signed());
        let contraction_ns = interval.and_then(|interval| self.contraction(interval)).unwrap_or(0);
        if let Some(interval) = interval.filter(|interval| *interval > 0) {
            self.intervals[self.count % INTERVALS] = interval;
            self.count += 1;
        }
        let rises_by = |contraction_ns: i64| delay_ns >= LEAST_RISE * contraction_ns as f64;
        self.hypothesis = match self.hypothesis {
            Some(step) if rises_by(step.contraction_ns) => {
                Some(StepHypothesis { frames: step.frames + 1, ..step })
            }
            _ if contraction_ns >= LEAST_CONTRACTION_NS && rises_by(contraction_ns) => {
                let stamp_ns = stamp_ns.max(last_ns.unwrap_or(0));
                Some(StepHypothesis { since: arrival, stamp_ns, frames: 1, contraction_ns })
            }
            _ => None,
        };
        self.hypothesis
    }

    /// Ends the hypothesis: the step is known.
    pub fn settle(&mut self) {
        self.hypothesis = None;
    }

    /// By how much the interval is shorter than any before \[ns\]; `None` while too few are known.
    fn contraction(&self, interval_ns: i64) -> Option<i64> {
        let known = &self.intervals[..self.count.min(INTERVALS)];
        let shortest = known.iter().min().filter(|_| known.len() >= LEAST_INTERVALS)?;
        Some(shortest.saturating_sub(interval_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shows frames 10 ms apart, from the given one, with this step of the stamps and this delay.
    fn show(watch: &mut StepWatch, frames: std::ops::Range<i64>, (step_ms, delay_ms): (i64, i64)) {
        for frame in frames {
            let at = Time::VIRTUAL_START + Span::from_millis(10 * frame);
            let stamp = at + Span::from_millis(step_ms);
            watch.observe(stamp.nanos(), at + Span::from_millis(delay_ms), delay_ms as f64 * 1e6);
        }
    }

    #[test]
    fn a_step_back_is_distinguished_from_a_longer_delay() {
        let mut steady = StepWatch::default();
        show(&mut steady, 0..20, (0, 0));
        let mut stepped = steady.clone();
        show(&mut stepped, 20..30, (-4, 4));
        let step = stepped.hypothesis.expect("a step");
        assert_eq!((step.frames, step.contraction_ns), (10, 4_000_000));
        let mut slowed = steady.clone();
        show(&mut slowed, 20..30, (0, 4));
        assert_eq!(slowed.hypothesis, None);
    }

    #[test]
    fn a_single_wrong_stamp_is_not_a_step() {
        let mut watch = StepWatch::default();
        show(&mut watch, 0..20, (0, 0));
        show(&mut watch, 20..21, (-4, 4));
        assert!(watch.hypothesis.is_some());
        show(&mut watch, 21..22, (0, 0));
        assert_eq!(watch.hypothesis, None);
    }
}
