//! Suspension of the machine, detected by comparison of two clocks of the kernel: one counts the time in suspension, the other
//! does not.

use rustix::time::ClockId;

use crate::time::{Span, Time};

/// Shortest suspension that is reported; a preemption between two readings of the clocks looks like a shorter one.
const SHORTEST: Span = Span::from_millis(10);

/// Readings of both clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockReadings {
    /// `CLOCK_MONOTONIC`, which does not count suspension.
    pub monotonic: Time,
    /// `CLOCK_BOOTTIME`, the clock of [`Time::now`].
    pub boot: Time,
    /// Upper bound of the time between the two readings.
    pub apart: Span,
}

impl ClockReadings {
    /// Reads both clocks.
    pub fn now() -> Self {
        let before = Time::now();
        let monotonic = Time::of_clock(ClockId::Monotonic);
        let boot = Time::now();
        Self { monotonic, boot, apart: boot.since(before) }
    }

    /// Converts the instant `at` of the boot-time clock to the monotonic clock, in which the kernel takes deadlines; early by up
    /// to the time between the readings, never late.
    pub fn on_monotonic(&self, at: Time) -> Time {
        self.monotonic + at.since(self.boot)
    }
}

/// Detects suspensions between its calls.
#[derive(Clone, Copy, Debug)]
pub struct SuspendWatch {
    /// Total time in suspension since boot: the least difference of the clocks since the last suspension, because every pair of
    /// readings overestimates it by the time between them.
    suspended: Span,
}

impl SuspendWatch {
    /// A watch that starts at `readings`.
    pub fn new(readings: &ClockReadings) -> Self {
        Self { suspended: readings.boot.since(readings.monotonic) }
    }

    /// Length of a suspension since the last call; `None` without one.
    pub fn observe(&mut self, readings: &ClockReadings) -> Option<Span> {
        let suspended = readings.boot.since(readings.monotonic);
        let longer = suspended - self.suspended;
        // The excess is due to the time between the two readings; a later pair is more accurate.
        if longer <= SHORTEST + readings.apart {
            self.suspended = self.suspended.min(suspended);
            return None;
        }
        self.suspended = suspended;
        Some(longer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings `run_ms` after the clocks started, including `suspended_ms` in suspension.
    fn readings(run_ms: i64, suspended_ms: i64) -> ClockReadings {
        let monotonic = Time::from_nanos(1) + Span::from_millis(run_ms);
        let boot = monotonic + Span::from_millis(suspended_ms);
        ClockReadings { monotonic, boot, apart: Span::from_nanos(80) }
    }

    #[test]
    fn f12_a_suspension_is_reported_once_and_passing_time_is_not() {
        let mut watch = SuspendWatch::new(&readings(0, 5000));
        assert_eq!(watch.observe(&readings(3_600_000, 5000)), None);
        assert_eq!(watch.observe(&readings(3_600_001, 5009)), None);
        let night = watch.observe(&readings(3_600_002, 5000 + 28_800_000));
        assert_eq!(night, Some(Span::from_millis(28_800_000)));
        assert_eq!(watch.observe(&readings(3_600_003, 5000 + 28_800_000)), None);
    }

    #[test]
    fn f12_losing_the_processor_between_two_readings_is_not_a_suspension() {
        let mut watch = SuspendWatch::new(&readings(0, 0));
        let torn = ClockReadings { apart: Span::from_millis(300), ..readings(50, 299) };
        assert_eq!(watch.observe(&torn), None);
        assert_eq!(watch.observe(&readings(400, 0)), None);
    }

    #[test]
    fn f12_a_suspension_after_torn_first_readings_is_reported() {
        let torn = ClockReadings { apart: Span::from_millis(300), ..readings(0, 299) };
        let mut watch = SuspendWatch::new(&torn);
        assert_eq!(watch.observe(&readings(500, 0)), None);
        assert_eq!(watch.observe(&readings(600, 250)), Some(Span::from_millis(250)));
    }

    #[test]
    fn a_deadline_is_as_far_away_on_either_clock() {
        let now = readings(1000, 70_000);
        let deadline = now.boot + Span::from_millis(25);
        assert_eq!(now.on_monotonic(deadline), now.monotonic + Span::from_millis(25));
        let real = ClockReadings::now();
        assert!(real.boot >= real.monotonic || real.apart > Span::ZERO);
    }
}
