//! A quantity over the last minutes, in steps of equal duration.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};

/// Duration of a step.
pub const STEP: Span = Span::from_millis(500);
/// Maximum number of stored steps \[-\]: five minutes, more than the width of a terminal.
const KEPT: usize = 600;

/// The greatest value of each step; steps without a sample are gaps.
#[derive(Debug, Default)]
pub struct Trend {
    /// Steps, oldest first.
    steps: VecDeque<Option<f64>>,
    /// Beginning of the newest step.
    newest: Option<Time>,
}

impl Trend {
    /// Begins every step up to `now`.
    pub fn advance(&mut self, now: Time) {
        let mut newest = *self.newest.get_or_insert(now);
        if self.steps.is_empty() || now.since(newest) > STEP.scaled(KEPT as f64) {
            self.steps = VecDeque::from([None]);
            newest = now;
        }
        while now.since(newest) >= STEP {
            newest = newest + STEP;
            if self.steps.len() == KEPT {
                self.steps.pop_front();
            }
            self.steps.push_back(None);
        }
        self.newest = Some(newest);
    }

    /// Adds a value to the newest step; non-finite numbers are ignored.
    pub fn add(&mut self, value: f64) {
        if let Some(step) = self.steps.back_mut().filter(|_| value.is_finite()) {
            *step = Some(step.map_or(value, |most| most.max(value)));
        }
    }

    /// The newest `count` steps, newest first.
    pub fn newest_first(&self, count: usize) -> impl Iterator<Item = Option<f64>> {
        self.steps.iter().rev().take(count).copied()
    }

    /// Value of the newest step that has one.
    pub fn latest(&self) -> Option<f64> {
        self.steps.iter().rev().take(2).flatten().next().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_step_has_its_greatest_value_and_pauses_are_gaps() {
        let mut trend = Trend::default();
        for (millis, value) in [(0, 1.0), (200, 3.0), (499, 2.0), (500, 5.0), (1700, f64::NAN)] {
            trend.advance(at(millis));
            trend.add(value);
        }
        let newest: Vec<_> = trend.newest_first(9).collect();
        assert_eq!(newest, [None, None, Some(5.0), Some(3.0)]);
        assert_eq!(trend.latest(), None);
    }

    #[test]
    fn a_long_pause_forgets_and_the_number_of_steps_is_bounded() {
        let mut trend = Trend::default();
        for step in 0..2 * KEPT as i64 {
            trend.advance(at(step * 500));
            trend.add(1.0);
        }
        assert_eq!(trend.newest_first(usize::MAX).count(), KEPT);
        trend.advance(at(10_000_000_000));
        assert_eq!(trend.newest_first(usize::MAX).collect::<Vec<_>>(), [None]);
    }
}
