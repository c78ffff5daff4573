//! Selection of the recorded truth samples: the nearest to each tick of the daemon, from which errors are computed, and further
//! samples at a configured rate.

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};

use crate::nearest::NearestJoin;
use crate::sink::Reception;

/// Maximum number of ticks waiting for a sample \[-\]; more mean that there is no truth.
const MAX_TICKS: usize = 64;

/// Truth sample with its reception.
pub type TrueSample = (Reception, TruthV1);

/// Selection of the recorded samples.
#[derive(Debug)]
pub struct TruthSelection {
    /// Time between samples that do not belong to a tick; `None` for no such samples.
    spacing: Option<Span>,
    due: Time,
    /// Ticks, and samples with a flag: whether the sample was selected.
    join: NearestJoin<(), (TrueSample, bool)>,
}

impl TruthSelection {
    /// Selection at `rate_hz` in addition to the samples of ticks; 0 for the samples of ticks only.
    pub fn new(rate_hz: f64) -> Self {
        let spacing = (rate_hz > 0.0).then(|| Span::period_of(rate_hz));
        Self { spacing, due: Time::UNSET, join: NearestJoin::default() }
    }

    /// Adds a tick of the daemon; passes its nearest sample to `choose` if it is already known.
    pub fn tick(&mut self, at: Time, choose: &mut dyn FnMut(&TrueSample)) {
        self.join.add_tick(at, ());
        if self.join.ticks() > MAX_TICKS {
            self.join.next_tick();
        }
        self.choose_joined(choose);
    }

    /// Adds a sample; passes selected samples to `choose`, samples of earlier ticks first.
    pub fn sample(&mut self, sample: TrueSample, choose: &mut dyn FnMut(&TrueSample)) {
        let time = sample.1.time;
        self.join.add_sample(time, (sample, false));
        self.choose_joined(choose);
        let Some(spacing) = self.spacing.filter(|_| time >= self.due) else { return };
        let next = self.due + spacing;
        self.due = if next > time { next } else { time + spacing };
        self.choose_newest(choose);
    }

    /// Passes the newest sample to `choose`, so that a reader can also join the last ticks.
    pub fn choose_newest(&mut self, choose: &mut dyn FnMut(&TrueSample)) {
        if let Some(newest) = self.join.newest() {
            choose_once(newest, choose);
        }
    }

    /// Selects the nearest sample for every tick that is not later than the newest sample.
    fn choose_joined(&mut self, choose: &mut dyn FnMut(&TrueSample)) {
        while let Some(((), nearest)) = self.join.next_pair() {
            choose_once(nearest, choose);
        }
    }
}

fn choose_once(sample: &mut (TrueSample, bool), choose: &mut dyn FnMut(&TrueSample)) {
    let (sample, was_chosen) = sample;
    if !std::mem::replace(was_chosen, true) {
        choose(sample);
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
        selection.choose_newest(&mut choose);
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
        selection.choose_newest(&mut |_| count += 1);
        assert_eq!(count, 1);
    }
}
