//! Occupancy of the line: the bytes handed to a port leave it one after another, at the rate of its transport.

use oqtal_bus::time::{Span, Time};

/// Occupancy of a line, computed from the bytes that were handed to its port.
#[derive(Clone, Copy, Debug)]
pub struct LineOccupancy {
    /// \[byte/s\]; `None` if bytes leave at once.
    byte_rate: Option<f64>,
    free_at: Time,
}

impl LineOccupancy {
    /// Free line of `byte_rate` \[byte/s\]; `None` for a transport whose frames leave at once.
    pub fn new(byte_rate: Option<f64>) -> Self {
        Self { byte_rate, free_at: Time::UNSET }
    }

    /// Time that `bytes` occupy the line.
    pub fn time_for(&self, bytes: usize) -> Span {
        self.byte_rate.map_or(Span::ZERO, |rate| Span::from_seconds(bytes as f64 / rate))
    }

    /// Adds `bytes` that were handed over at `now`; returns the time until the last of them has left.
    pub fn add(&mut self, now: Time, bytes: usize) -> Span {
        self.free_at = self.free_at.max(now) + self.time_for(bytes);
        self.free_at.since(now)
    }

    /// Time until the line is free; zero if it is.
    pub fn ahead(&self, now: Time) -> Span {
        self.free_at.since(now).max(Span::ZERO)
    }

    /// Instant at which the line becomes, or became, free; unset if nothing was handed over.
    pub fn free_at(&self) -> Time {
        self.free_at
    }

    /// Frees the line: what was handed over is discarded.
    pub fn clear(&mut self) {
        self.free_at = Time::UNSET;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_queue_behind_those_before_them() {
        let (mut line, now) = (LineOccupancy::new(Some(5760.0)), Time::VIRTUAL_START);
        // 17 bytes of 10 bits at 57600 baud.
        assert_eq!(line.add(now, 17), Span::from_nanos(2_951_389));
        let then = now + Span::from_millis(1);
        assert_eq!(line.add(then, 6), Span::from_nanos(1_951_389 + 1_041_667));
        assert_eq!(line.ahead(then + Span::from_millis(3)), Span::ZERO);
    }

    #[test]
    fn a_line_without_a_rate_is_always_free() {
        let (mut line, now) = (LineOccupancy::new(None), Time::VIRTUAL_START);
        assert_eq!((line.add(now, 280), line.ahead(now)), (Span::ZERO, Span::ZERO));
    }
}
