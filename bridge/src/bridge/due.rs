//! Instants at which the bridge has something to do.

use oqtal_bus::time::{Span, Time};

use super::Bridge;

/// Time after which a busy vehicle is looked at again.
const BUSY_POLL: Span = Span::from_millis(1);

impl Bridge {
    /// Whether set-points wait for a busy vehicle; a stop does not.
    pub(super) fn holds_back(&self, now: Time) -> bool {
        self.stopped_since.is_none() && self.protocol.is_busy(now)
    }

    /// Instant at which something is due without a command.
    pub fn next_event(&self, now: Time) -> Time {
        let clear_at = self.outbox.clear_at(now);
        let least = if self.holds_back(now) { now + BUSY_POLL } else { clear_at };
        let due = self.outbox.retry_at(now).unwrap_or(if self.command_waits {
            least
        } else {
            self.next_setpoint().max(least)
        });
        let read_at = self.protocol.read_period().map(|period| self.read_at + period);
        read_at.filter(|_| self.is_open).map_or(due, |read_at| due.min(read_at))
    }

    /// Instant of the next set-point if no command arrives: a flight command is followed by zero as soon as it times out.
    fn next_setpoint(&self) -> Time {
        let next = self.schedule.next_setpoint();
        let times_out_at = self.gate.times_out_at().filter(|_| self.flies);
        times_out_at.map_or(next, |at| next.min(at))
    }

    /// Whether a set-point is due at `now`.
    pub(super) fn is_setpoint_due(&self, now: Time) -> bool {
        self.command_waits || now >= self.next_setpoint()
    }
}
