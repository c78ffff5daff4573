//! Search for the sample nearest in time, among samples in order of time.

use std::collections::VecDeque;

use oqtal_bus::time::Time;

/// Number of stored samples, among which a late tick finds the nearest one \[-\].
const KEPT: usize = 64;

/// Index of the sample in `samples` nearest to `at`, the earlier of two equally near ones; `None` without samples.
pub fn nearest<T>(samples: &VecDeque<T>, at: Time, time: impl Fn(&T) -> Time) -> Option<usize> {
    let after = samples.partition_point(|sample| time(sample) < at);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let distance = |index: &usize| time(&samples[*index]).since(at).nanos().abs();
    around.filter(|index| *index < samples.len()).min_by_key(distance)
}

/// Joins the daemon's ticks with the nearest truth samples; ticks and samples each arrive in order of time.
#[derive(Debug)]
pub struct NearestJoin<T, S> {
    ticks: VecDeque<(Time, T)>,
    /// The newest samples, oldest first.
    samples: VecDeque<(Time, S)>,
}

impl<T, S> Default for NearestJoin<T, S> {
    fn default() -> Self {
        Self { ticks: VecDeque::new(), samples: VecDeque::with_capacity(KEPT) }
    }
}

impl<T, S> NearestJoin<T, S> {
    /// Adds a tick.
    pub fn add_tick(&mut self, at: Time, tick: T) {
        self.ticks.push_back((at, tick));
    }

    /// Adds a truth sample.
    pub fn add_sample(&mut self, at: Time, sample: S) {
        if self.samples.len() == KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back((at, sample));
    }

    /// Removes and returns the first tick that is not later than the newest sample, with its nearest sample.
    pub fn next_pair(&mut self) -> Option<(T, &mut S)> {
        let newest = self.samples.back()?.0;
        let at = self.ticks.front().map(|(at, _)| *at).filter(|at| *at <= newest)?;
        let index = nearest(&self.samples, at, |(at, _)| *at)?;
        let tick = self.next_tick()?;
        Some((tick, &mut self.samples[index].1))
    }

    /// Removes and returns the first tick, without a sample.
    pub fn next_tick(&mut self) -> Option<T> {
        self.ticks.pop_front().map(|(_, tick)| tick)
    }

    /// Times of the first and last tick waiting for a sample; `None` if none is waiting.
    pub fn waiting(&self) -> Option<(Time, Time)> {
        Some((self.ticks.front()?.0, self.ticks.back()?.0))
    }

    /// Number of ticks waiting for a sample \[-\].
    pub fn ticks(&self) -> usize {
        self.ticks.len()
    }

    /// Time of the oldest stored sample; `None` without samples.
    pub fn oldest(&self) -> Option<Time> {
        self.samples.front().map(|(at, _)| *at)
    }

    /// The newest sample.
    pub fn newest(&self) -> Option<&S> {
        self.samples.back().map(|(_, sample)| sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_sample_is_found_and_of_two_the_earlier() {
        let samples = VecDeque::from([10, 20, 20, 30].map(Time::from_nanos));
        let at = |nanos| nearest(&samples, Time::from_nanos(nanos), |time| *time);
        assert_eq!([1, 14, 15, 16, 20, 26, 99].map(at), [0, 0, 0, 1, 1, 3, 3].map(Some));
        assert_eq!(nearest(&VecDeque::<Time>::new(), Time::UNSET, |time| *time), None);
    }
}
