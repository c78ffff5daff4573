//! Time of a body that waits for its firmware. Pure.

use oqtal_bus::time::{Span, Time};

/// Time by which the body may be ahead of the firmware's last motor values: slightly more than their interval. A busy processor
/// can delay the firmware by more than its control loops tolerate; the body then waits.
const LEAD: Span = Span::from_millis(3);
/// Longest time for which the body waits for motor values.
const MOTOR_TIMEOUT: Span = Span::from_millis(20);
/// Time without motor values after which the firmware counts as dead.
const FIRMWARE_TIMEOUT: Span = Span::from_millis(250);

/// Clock of a body.
#[derive(Clone, Copy, Debug)]
pub struct BodyClock {
    /// Arrival of the last motor values; `None` while the firmware is not running.
    driven_at: Option<Time>,
    /// Time of the body at that arrival.
    body_driven_at: Time,
    /// Total time for which the body has waited for the firmware; the body's time lags by it.
    slip: Span,
}

impl BodyClock {
    /// Clock of a body whose firmware is not running yet.
    pub fn new() -> Self {
        Self { driven_at: None, body_driven_at: Time::UNSET, slip: Span::ZERO }
    }

    /// Total time for which the body has waited.
    pub fn slip(&self) -> Span {
        self.slip
    }

    /// Records motor values that arrived at `now`, when the body's time was `body`.
    pub fn drive(&mut self, now: Time, body: Time) {
        (self.driven_at, self.body_driven_at) = (Some(now), body);
    }

    /// Logs that the firmware is silent; the plant itself stops the motors.
    pub fn watch(&mut self, now: Time) {
        if self.driven_at.is_some_and(|at| now.since(at) > FIRMWARE_TIMEOUT) {
            self.driven_at = None;
            tracing::warn!("the firmware is silent, its motors are off");
        }
    }

    /// The next instant at which the loop must act without a datagram; `next` is the body's next event.
    pub fn next_event(&self, next: Time) -> Time {
        match self.driven_at {
            Some(at) if next > self.body_driven_at + LEAD => {
                (next + self.slip).max(at + MOTOR_TIMEOUT)
            }
            _ => next + self.slip,
        }
    }

    /// The body's time at `now`, no earlier than `body`; the body waits for a firmware that is late.
    pub fn body_time(&mut self, now: Time, body: Time) -> Time {
        let wanted = now - self.slip;
        let is_awaited = self.driven_at.is_some_and(|at| now.since(at) < MOTOR_TIMEOUT);
        let until = if is_awaited { wanted.min(self.body_driven_at + LEAD) } else { wanted };
        let until = until.max(body);
        self.slip = now.since(until);
        until
    }
}
