//! Schedule of periodic messages.

use oqtal_bus::time::{Span, Time};

/// Period of a message, and the instant at which it is due. Missed messages are not made up for.
#[derive(Clone, Copy, Debug)]
pub(super) struct MessageSchedule {
    period: Span,
    next: Time,
}

impl MessageSchedule {
    /// Schedule with period `period`, starting at `first`.
    pub(super) fn new(first: Time, period: Span) -> Self {
        Self { period, next: first }
    }

    /// Instant at which the message is due next.
    pub(super) fn next(&self) -> Time {
        self.next
    }

    /// Whether the message is due at `now`; if so, advances the schedule by a period.
    pub(super) fn is_due(&mut self, now: Time) -> bool {
        let is_due = self.next <= now;
        if is_due {
            self.next = (self.next + self.period).max(now);
        }
        is_due
    }
}
