//! Overruns of a loop: counts turns that end too late, and detects several in a row.

use oqtal_bus::time::{Span, Time};

/// Late turns in a row with which the loop counts as running late \[-\].
const LATE_IN_A_ROW: u32 = 3;
/// Time without a late turn after which it no longer does.
const RECOVERY: Span = Span::from_millis(1000);

/// Counts the late turns of a loop. A turn that could not begin in time is late as well as one that lasted too long; a turn is
/// never executed twice to catch up. Pure.
#[derive(Clone, Debug)]
pub struct OverrunMonitor {
    /// Time from the instant at which a turn was due to its end, at most.
    allowed: Span,
    late_turns: u64,
    in_a_row: u32,
    last_late: Time,
    runs_late: bool,
}

impl OverrunMonitor {
    /// A monitor of a loop whose turns end within `allowed` after they were due.
    #[must_use]
    pub fn new(allowed: Span) -> Self {
        Self { allowed, late_turns: 0, in_a_row: 0, last_late: Time::UNSET, runs_late: false }
    }

    /// Takes the end of a turn that was due at `due`.
    pub fn turn_ended(&mut self, due: Time, ended: Time) {
        if ended.since(due) > self.allowed {
            self.late_turns += 1;
            self.in_a_row += 1;
            self.last_late = ended;
            self.runs_late |= self.in_a_row >= LATE_IN_A_ROW;
        } else {
            self.in_a_row = 0;
            self.runs_late &= ended.since(self.last_late) < RECOVERY;
        }
    }

    /// Late turns so far \[-\].
    #[must_use]
    pub fn late_turns(&self) -> u64 {
        self.late_turns
    }

    /// Whether the loop runs late: three turns in a row were late, and less than a second has passed since the last late one.
    #[must_use]
    pub fn runs_late(&self) -> bool {
        self.runs_late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::from_nanos(16_666_667);
    const BUSY: Span = Span::from_millis(30);
    const BRIEF: Span = Span::from_millis(1);

    /// A monitor, and the instant at which the last turn of these durations ended; each is due a period after the one before.
    fn after(turns: &[Span]) -> (OverrunMonitor, Time) {
        let mut monitor = OverrunMonitor::new(PERIOD);
        let mut due = Time::VIRTUAL_START;
        let mut ended = due;
        for &lasts in turns {
            due = due + PERIOD;
            ended = ended.max(due) + lasts;
            monitor.turn_ended(due, ended);
        }
        (monitor, ended)
    }

    #[test]
    fn f22_three_late_turns_in_a_row_are_an_overrun_and_two_are_not() {
        let (monitor, _) = after(&[BRIEF, BUSY, BUSY]);
        assert!(!monitor.runs_late());
        assert_eq!(monitor.late_turns(), 2);
        let (monitor, _) = after(&[BUSY, BUSY, BUSY]);
        assert!(monitor.runs_late());
        let mut interrupted = OverrunMonitor::new(PERIOD);
        for k in 0..9 {
            let due = Time::VIRTUAL_START + PERIOD.scaled(f64::from(k * 3));
            let lasts = if k % 3 == 2 { BRIEF } else { BUSY };
            interrupted.turn_ended(due, due + lasts);
        }
        assert!(!interrupted.runs_late());
        assert_eq!(interrupted.late_turns(), 6);
    }

    #[test]
    fn f22_an_overrun_ends_a_second_after_the_last_late_turn() {
        let (mut monitor, ended) = after(&[BUSY, BUSY, BUSY]);
        let almost = ended + RECOVERY - BRIEF;
        monitor.turn_ended(almost - BRIEF, almost);
        assert!(monitor.runs_late());
        monitor.turn_ended(ended + RECOVERY, ended + RECOVERY);
        assert!(!monitor.runs_late());
    }

    #[test]
    fn a_single_late_turn_is_not_an_overrun() {
        let (monitor, _) = after(&[BRIEF, Span::from_millis(10)]);
        assert_eq!(monitor.late_turns(), 0);
        let mut stopped = OverrunMonitor::new(PERIOD);
        let due = Time::VIRTUAL_START;
        stopped.turn_ended(due, due + Span::from_millis(10_000));
        assert!(!stopped.runs_late() && stopped.late_turns() == 1);
    }
}
