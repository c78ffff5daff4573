//! The samples of the truth that are recorded: those nearest to the daemon's ticks, from which errors are computed, and others at
//! a chosen rate.

use std::collections::VecDeque;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};

use crate::nearest::nearest;
use crate::sink::Reception;

/// Samples among which the nearest to a tick is found, as many as the flight recorder keeps.
const KEPT: usize = 64;

/// A sample of the truth, as it was received.
pub type TrueSample = (Reception, TruthV1);

/// Chooses the samples that are recorded.
#[derive(Debug)]
pub struct TruthSelection {
    /// Time between two samples that belong to no tick; `None` for none.
    spacing: Option<Span>,
    due: Time,
    /// The newest samples, oldest first, and whether each was chosen.
    newest: VecDeque<(TrueSample, bool)>,
    /// Ticks later than the newest sample.
    ticks: VecDeque<Time>,
}

impl TruthSelection {
    /// A selection at `rate_hz` beside the samples of ticks; 0 for those alone.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        Self {
            spacing: (rate_hz > 0.0).then(|| Span::period_of(rate_hz)),
            due: Time::UNSET,
            newest: VecDeque::with_capacity(KEPT),
            ticks: VecDeque::new(),
        }
    }

    /// Takes a tick of the daemon; passes the sample nearest to it to `choose` if that is known already.
    pub fn tick(&mut self, at: Time, choose: &mut dyn FnMut(&TrueSample)) {
        self.ticks.push_back(at);
        if self.ticks.len() > KEPT {
            // There is no truth.
            self.ticks.pop_front();
        }
        self.join(choose);
    }

    /// Takes a sample; passes chosen samples to `choose`, those of earlier ticks first.
    pub fn sample(&mut self, sample: TrueSample, choose: &mut dyn FnMut(&TrueSample)) {
        if self.newest.len() == KEPT {
            self.newest.pop_front();
        }
        self.newest.push_back((sample, false));
        self.join(choose);
        let time = sample.1.time;
        let Some(spacing) = self.spacing.filter(|_| time >= self.due) else { return };
        let next = self.due + spacing;
        self.due = if next > time { next } else { time + spacing };
        if let Some((newest, chosen @ false)) = self.newest.back_mut() {
            *chosen = true;
            choose(newest);
        }
    }

    /// Passes the newest sample to `choose`, so that the last ticks are known to lie before it.
    pub fn finish(&mut self, choose: &mut dyn FnMut(&TrueSample)) {
        if let Some((sample, false)) = self.newest.back() {
            choose(sample);
        }
    }

    /// Chooses the nearest sample for every tick that is not later than the newest one.
    fn join(&mut self, choose: &mut dyn FnMut(&TrueSample)) {
        let Some(newest) = self.newest.back().map(|((_, truth), _)| truth.time) else { return };
        while let Some(tick) = self.ticks.front().copied().filter(|tick| *tick <= newest) {
            self.ticks.pop_front();
            let index = nearest(&self.newest, tick, |((_, truth), _)| truth.time);
            if let Some((sample, chosen @ false)) = index.map(|index| &mut self.newest[index]) {
                *chosen = true;
                choose(sample);
            }
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

    #[test]
    fn ticks_have_their_nearest_sample_and_others_come_at_the_rate() {
        let mut selection = TruthSelection::new(100.0);
        let mut chosen = Vec::new();
        let mut choose = |(_, truth): &TrueSample| chosen.push(truth.time);
        for millis in 0..40 {
            if millis % 17 == 0 {
                selection.tick(at(millis) + Span::from_nanos(400_000), &mut choose);
            }
            selection.sample(sample(millis), &mut choose);
        }
        selection.finish(&mut choose);
        assert_eq!(chosen, [0, 10, 17, 20, 30, 34, 39].map(at));
    }

    #[test]
    fn without_a_rate_only_ticks_count() {
        let mut selection = TruthSelection::new(0.0);
        let mut count = 0;
        for millis in 0..100 {
            selection.sample(sample(millis), &mut |_| count += 1);
        }
        assert_eq!(count, 0);
        selection.tick(at(99), &mut |(_, truth)| {
            assert_eq!(truth.time, at(99));
            count += 1;
        });
        selection.finish(&mut |_| count += 1);
        assert_eq!(count, 1);
    }
}
