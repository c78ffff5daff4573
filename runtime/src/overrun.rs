//! Overruns of a loop: counts late turns, and detects several in a row.

use oqtal_bus::time::{Span, Time};

/// Number of consecutive late turns after which the loop counts as running late \[-\].
const LATE_IN_A_ROW: u32 = 3;
/// Time without a late turn after which the loop no longer counts as running late.
const RECOVERY: Span = Span::from_millis(1000);

/// Counts the late turns of a loop. A turn is late if it starts late or takes too long; turns are never repeated to catch up.
/// Pure.
#[derive(Clone, Debug)]
pub struct OverrunMonitor {
    /// Maximum time from the due instant of a turn to its end.
    allowed: Span,
    late_turns: u64,
    in_a_row: u32,
    last_late: Time,
    runs_late: bool,
}

impl OverrunMonitor {
    /// Monitor of a loop whose turns should end within `allowed` after they are due.
    pub fn new(allowed: Span) -> Self {
        Self { allowed, late_turns: 0, in_a_row: 0, last_late: Time::UNSET, runs_late: false }
    }

    /// Records the end of a turn that was due at `due`.
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

    /// Number of late turns so far \[-\].
    pub fn late_turns(&self) -> u64 {
        self.late_turns
    }

    /// Whether the loop runs late: three turns in a row were late, and less than a second has passed since the last late one.
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

    /// A monitor after turns of these durations, each due one period after the previous one, and the end of the last turn.
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
