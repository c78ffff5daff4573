//! Set-points that wait in the vehicle. Betaflight reads one request each time its serial task is executed, nominally every 10 ms; a
//! processor that is busy executes it less often, and requests then queue up.

use oqtal_bus::time::{Span, Time};

/// Number of waiting set-points above which none is sent \[-\].
const MOST_WAITING: u8 = 2;
/// Time without a reply after which nothing counts as waiting: replies are lost, or the vehicle is silent.
const LOST_AFTER: Span = Span::from_millis(100);

/// Number of set-points that were sent and not acknowledged.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Backlog {
    waiting: u8,
    /// Number of set-points sent after the last status request, whose reply shows that all earlier ones were executed or lost.
    after_status: u8,
    /// Last reply, or the first set-point that waits.
    since: Option<Time>,
}

impl Backlog {
    /// Records a set-point that is sent at `now`.
    pub(super) fn send(&mut self, now: Time) {
        if self.waiting == 0 || !self.is_counted(now) {
            (self.waiting, self.after_status, self.since) = (0, 0, Some(now));
        }
        self.waiting = self.waiting.saturating_add(1);
        self.after_status = self.after_status.saturating_add(1);
    }

    /// Records a request of the status.
    pub(super) fn request_status(&mut self) {
        self.after_status = 0;
    }

    /// Takes the acknowledgement of a set-point.
    pub(super) fn acknowledge(&mut self, now: Time) {
        (self.waiting, self.since) = (self.waiting.saturating_sub(1), Some(now));
    }

    /// Takes a status.
    pub(super) fn take_status(&mut self, now: Time) {
        (self.waiting, self.since) = (self.waiting.min(self.after_status), Some(now));
    }

    /// Whether too many set-points wait for another to be sent.
    pub(super) fn is_long(&self, now: Time) -> bool {
        self.waiting > MOST_WAITING && self.is_counted(now)
    }

    fn is_counted(&self, now: Time) -> bool {
        self.since.is_some_and(|since| now.since(since) < LOST_AFTER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_fourth_set_point_waits_for_an_acknowledgement_for_a_tenth_of_a_second() {
        let mut backlog = Backlog::default();
        for millis in [0, 17, 33] {
            assert!(!backlog.is_long(at(millis)));
            backlog.send(at(millis));
        }
        assert!(backlog.is_long(at(34)));
        backlog.acknowledge(at(50));
        assert!(!backlog.is_long(at(50)));
        backlog.send(at(50));
        assert!(backlog.is_long(at(149)) && !backlog.is_long(at(150)));
        backlog.send(at(150));
        assert!(!backlog.is_long(at(151)), "those before are lost");
    }

    #[test]
    fn a_lost_acknowledgement_is_forgotten_with_the_next_status() {
        let mut backlog = Backlog::default();
        (0..3).for_each(|_| backlog.send(at(0)));
        backlog.request_status();
        assert!(backlog.is_long(at(1)));
        backlog.take_status(at(20));
        assert!(!backlog.is_long(at(20)));
        (0..2).for_each(|_| backlog.send(at(20)));
        assert!(!backlog.is_long(at(21)), "of the first three none waits");
    }
}
