//! Selection of the recorded truth samples: the nearest to each tick of the daemon, from which errors are computed, and further
//! samples at a configured rate.

use std::collections::VecDeque;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};

use crate::nearest::NearestJoin;
use crate::sink::Reception;

/// Maximum number of ticks waiting for a sample \[-\]; more mean that there is no truth.
const MAX_TICKS: usize = 64;

/// Truth sample with its reception.
pub type TrueSample = (Reception, TruthV1);

/// Selection of the recorded samples.
#[derive(Debug, Default)]
pub struct TruthSelection {
    /// Time between samples that do not belong to a tick; `None` for no such samples.
    spacing: Option<Span>,
    due: Time,
    join: NearestJoin<(), TrueSample>,
    /// Selected samples, oldest first, that are withheld while a late tick may still select an earlier sample.
    withheld: VecDeque<TrueSample>,
    /// Samples passed on and not yet taken.
    passed: Vec<TrueSample>,
    /// Time of the sample passed on last.
    passed_at: Time,
}

impl TruthSelection {
    /// Selection at `rate_hz` in addition to the samples of ticks; 0 for the samples of ticks only.
    pub fn new(rate_hz: f64) -> Self {
        let spacing = (rate_hz > 0.0).then(|| Span::period_of(rate_hz));
        Self { spacing, ..Self::default() }
    }

    /// The samples selected since the last call, in order of time.
    pub fn take(&mut self) -> Vec<TrueSample> {
        std::mem::take(&mut self.passed)
    }

    /// Adds a tick of the daemon; selects its nearest sample if it is already known.
    pub fn tick(&mut self, at: Time) {
        self.join.add_tick(at, ());
        if self.join.ticks() > MAX_TICKS {
            self.join.next_tick();
        }
        self.choose_joined();
    }

    /// Adds a sample.
    pub fn sample(&mut self, sample: TrueSample) {
        let time = sample.1.time;
        self.join.add_sample(time, sample);
        if let Some(spacing) = self.spacing.filter(|_| time >= self.due) {
            let next = self.due + spacing;
            self.due = if next > time { next } else { time + spacing };
            self.withheld.push_back(sample);
        }
        self.choose_joined();
        let oldest = self.join.oldest().unwrap_or(time);
        self.pass_until(oldest);
    }

    /// Selects the newest sample, so that a reader can also join the last ticks.
    pub fn choose_newest(&mut self) {
        if let Some(newest) = self.join.newest().copied() {
            self.pass(newest);
        }
    }

    /// Selects the nearest sample for every tick that is not later than the newest sample.
    fn choose_joined(&mut self) {
        while let Some(((), nearest)) = self.join.next_pair() {
            let nearest = *nearest;
            self.pass(nearest);
        }
    }

    /// Passes the withheld samples up to `sample`, and `sample` unless it was passed.
    fn pass(&mut self, sample: TrueSample) {
        self.pass_until(sample.1.time);
        if std::mem::replace(&mut self.passed_at, sample.1.time) != sample.1.time {
            self.passed.push(sample);
        }
    }

    /// Passes the withheld samples up to the instant `until`.
    fn pass_until(&mut self, until: Time) {
        let count = self.withheld.partition_point(|sample| sample.1.time <= until);
        for sample in self.withheld.drain(..count) {
            self.passed_at = sample.1.time;
            self.passed.push(sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    fn sample(millis: i64) -> TrueSample {
        (Reception::default(), TruthV1 { time: at(millis), ..TruthV1::default() })
    }

    /// Times of the samples selected since the last call.
    fn taken(selection: &mut TruthSelection) -> Vec<Time> {
        selection.take().iter().map(|(_, truth)| truth.time).collect()
    }

    #[test]
    fn ticks_have_their_nearest_sample_and_others_come_at_the_rate() {
        let mut selection = TruthSelection::new(100.0);
        for millis in 0..40 {
            if millis % 17 == 0 {
                selection.tick(at(millis) + Span::from_nanos(400_000));
            }
            selection.sample(sample(millis));
        }
        selection.choose_newest();
        assert_eq!(taken(&mut selection), [0, 10, 17, 20, 30, 34, 39].map(at));
    }

    #[test]
    fn samples_keep_their_order_also_if_a_tick_is_late_or_no_tick_comes() {
        let mut selection = TruthSelection::new(100.0);
        (0..=12).for_each(|millis| selection.sample(sample(millis)));
        selection.tick(at(6));
        (13..=79).for_each(|millis| selection.sample(sample(millis)));
        assert_eq!(taken(&mut selection), [0, 6, 10].map(at));
    }

    #[test]
    fn without_a_rate_only_ticks_count() {
        let mut selection = TruthSelection::new(0.0);
        (0..100).for_each(|millis| selection.sample(sample(millis)));
        assert_eq!(taken(&mut selection), []);
        selection.tick(at(99));
        assert_eq!(taken(&mut selection), [at(99)]);
        selection.choose_newest();
        assert_eq!(taken(&mut selection), []);
    }
}
