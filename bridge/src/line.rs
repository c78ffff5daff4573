//! How busy the serial line is: bytes handed to a port go out one after the other, ten bit times each (8N1).

use oqtal_bus::time::{Span, Time};

/// Bit times of a byte on a serial line: start bit, eight data bits, stop bit.
const BITS_PER_BYTE: f64 = 10.0;

/// A serial line, as it is reckoned from what was handed to it.
#[derive(Clone, Copy, Debug)]
pub struct LineOccupancy {
    baud: f64,
    free_at: Time,
}

impl LineOccupancy {
    /// A line at `baud` that is free.
    #[must_use]
    pub fn new(baud: u32) -> Self {
        Self { baud: f64::from(baud), free_at: Time::UNSET }
    }

    /// What `bytes` take.
    #[must_use]
    pub fn time_for(&self, bytes: usize) -> Span {
        Span::from_seconds(bytes as f64 * BITS_PER_BYTE / self.baud)
    }

    /// Hands `bytes` over at `now`; the time until the last of them is out.
    pub fn take(&mut self, now: Time, bytes: usize) -> Span {
        self.free_at = self.free_at.max(now) + self.time_for(bytes);
        self.free_at.since(now)
    }

    /// The time until the line is free.
    #[must_use]
    pub fn ahead(&self, now: Time) -> Span {
        self.free_at.since(now).max(Span::ZERO)
    }

    /// When it is free, or was; unset if nothing was handed over.
    #[must_use]
    pub fn free_at(&self) -> Time {
        self.free_at
    }

    /// What was handed over is gone.
    pub fn clear(&mut self) {
        self.free_at = Time::UNSET;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_queue_behind_those_before_them() {
        let (mut line, now) = (LineOccupancy::new(57_600), Time::VIRTUAL_START);
        // 17 bytes of 10 bits at 57600 baud.
        assert_eq!(line.take(now, 17), Span::from_nanos(2_951_389));
        let then = now + Span::from_millis(1);
        assert_eq!(line.take(then, 6), Span::from_nanos(1_951_389 + 1_041_667));
        assert_eq!(line.ahead(then + Span::from_millis(3)), Span::ZERO);
    }
}
