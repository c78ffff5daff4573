//! Instants and spans of time in all processes: nanoseconds of `CLOCK_BOOTTIME`, or of virtual time.
//!
//! The boot-time clock is monotonic, common to all processes of the machine, and includes time in suspension: a stamp from before
//! a suspension is old after it.
//!
//! Only [`Time::now`] reads a clock, and only the process context and the loop clocks call it; all other code takes `now` as an
//! argument. `dt` is converted to `f64` once, by [`Span::seconds`], before it enters a control law.

use std::ops::{Add, Sub};

use iceoryx2::prelude::ZeroCopySend;
use rustix::time::{ClockId, Timespec, clock_gettime};
use serde::{Deserialize, Serialize};

const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// An instant \[ns\]. [`Time::UNSET`] (zero) means "not stamped yet".
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    ZeroCopySend,
)]
#[repr(C)]
pub struct Time(u64);

/// Signed difference of two instants \[ns\].
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[repr(transparent)]
pub struct Span(i64);

impl Time {
    /// No stamp.
    pub const UNSET: Self = Self(0);

    /// Start of virtual time: one second, so that a virtual stamp is never [`Time::UNSET`].
    pub const VIRTUAL_START: Self = Self(NANOS_PER_SECOND);

    /// The instant `nanos` after the clock's origin.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's origin.
    pub const fn nanos(self) -> u64 {
        self.0
    }

    /// The instant in the unit of filters and fits \[s since the clock's origin\]: a century is resolved to a microsecond.
    pub fn seconds(self) -> f64 {
        self.since(Self::UNSET).seconds()
    }

    /// Reads `CLOCK_BOOTTIME` (through the vDSO, no system call).
    pub fn now() -> Self {
        Self::of_clock(ClockId::Boottime)
    }

    /// Reads a clock of the kernel.
    #[expect(clippy::disallowed_methods, reason = "clocks are read here")]
    pub(crate) fn of_clock(clock: ClockId) -> Self {
        let Timespec { tv_sec, tv_nsec } = clock_gettime(clock);
        // The clocks count up from boot or from the epoch: both parts are non-negative.
        Self(tv_sec.unsigned_abs() * NANOS_PER_SECOND + tv_nsec.unsigned_abs())
    }

    /// Offset from the monotonic clock's origin to the Unix epoch, to be added to an instant of [`Time::now`]; reads the wall
    /// clock. Changes whenever the wall clock is set.
    pub fn wall_offset() -> Span {
        Self::of_clock(ClockId::Realtime).since(Self::now())
    }

    /// Whether the stamp is set.
    pub const fn is_set(self) -> bool {
        self.0 != 0
    }

    /// The time from `earlier` to `self`.
    pub const fn since(self, earlier: Self) -> Span {
        Span(self.0.wrapping_sub(earlier.0).cast_signed())
    }
}

impl Span {
    /// A span of zero length.
    pub const ZERO: Self = Self(0);

    /// A span of `nanos` nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// A span of `millis` milliseconds.
    pub const fn from_millis(millis: i64) -> Self {
        Self(millis * 1_000_000)
    }

    /// A span of `seconds`, to the nearest nanosecond.
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// One period of a `rate_hz` clock, to the nearest nanosecond.
    pub fn period_of(rate_hz: f64) -> Self {
        Self::from_seconds(1.0 / rate_hz)
    }

    /// Nanoseconds.
    pub const fn nanos(self) -> i64 {
        self.0
    }

    /// Seconds.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// This span times `factor`, to the nearest nanosecond.
    pub fn scaled(self, factor: f64) -> Self {
        Self((self.0 as f64 * factor).round() as i64)
    }

    /// Converts the span to a standard duration; a negative span to zero.
    pub fn to_duration(self) -> std::time::Duration {
        std::time::Duration::from_nanos(self.0.max(0).unsigned_abs())
    }
}

impl Add<Span> for Time {
    type Output = Self;

    fn add(self, span: Span) -> Self {
        Self(self.0.saturating_add_signed(span.0))
    }
}

impl Sub<Span> for Time {
    type Output = Self;

    fn sub(self, span: Span) -> Self {
        self + Span(-span.0)
    }
}

impl Add for Span {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for Span {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

/// The instants `start + k / rate` for k = 0, 1, ..., without the drift of a rounded period.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    start: Time,
    rate_hz: f64,
    /// Period of a rate whose period is a whole number of nanoseconds.
    period: Option<Span>,
    index: u64,
    next: Time,
}

impl Grid {
    /// A grid of `rate_hz` instants a second whose instant 0 is `start`.
    pub const fn new(start: Time, rate_hz: f64) -> Self {
        let period_ns = 1e9 / rate_hz;
        let whole = Span(period_ns as i64);
        let period = if whole.0 as f64 == period_ns { Some(whole) } else { None };
        Self { start, rate_hz, period, index: 0, next: start }
    }

    /// Index of the next instant \[-\].
    pub const fn index(&self) -> u64 {
        self.index
    }

    /// The next instant.
    pub const fn next(&self) -> Time {
        self.next
    }

    /// Advances to the first instant after `time`.
    pub fn skip_to(&mut self, time: Time) {
        let passed = (time.since(self.start).seconds() * self.rate_hz).floor();
        // The conversion saturates: an instant before the start does not change the index.
        self.index = self.index.max(passed as u64);
        while self.next <= time {
            self.advance();
        }
    }

    /// Advances by one instant.
    pub fn advance(&mut self) {
        self.index += 1;
        let since = match self.period {
            Some(period) => Span(period.0 * self.index.cast_signed()),
            None => Span::from_seconds(self.index as f64 / self.rate_hz),
        };
        self.next = self.start + since;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_signed_and_adds_back() {
        let (early, late) = (Time::from_nanos(5), Time::from_nanos(12));
        assert_eq!(late.since(early), Span::from_nanos(7));
        assert_eq!(early.since(late), Span::from_nanos(-7));
        assert_eq!(late + early.since(late), early);
    }

    #[test]
    fn a_grid_does_not_drift() {
        let mut grid = Grid::new(Time::VIRTUAL_START, 60.0);
        for _ in 0..60 * 3600 {
            grid.advance();
        }
        assert_eq!(grid.next().since(Time::VIRTUAL_START), Span::from_seconds(3600.0));
    }

    #[test]
    fn instants_are_the_same_by_a_whole_period_and_by_the_rate() {
        for rate_hz in [50.0, 100.0, 240.0, 250.0, 1000.0] {
            let mut grid = Grid::new(Time::VIRTUAL_START, rate_hz);
            assert_eq!(grid.period.is_some(), rate_hz != 240.0);
            for index in 1..=1_000_000_u32 {
                grid.advance();
                let since = Span::from_seconds(f64::from(index) / rate_hz);
                assert_eq!(grid.next(), Time::VIRTUAL_START + since, "{rate_hz} Hz, {index}");
            }
        }
    }

    #[test]
    fn a_grid_skips_to_the_first_instant_after_a_time() {
        let mut grid = Grid::new(Time::VIRTUAL_START, 60.0);
        for (millis, index) in
            [(-5, 0), (0, 1), (16, 1), (17, 2), (3_600_000, 216_001), (10, 216_001)]
        {
            grid.skip_to(Time::VIRTUAL_START + Span::from_millis(millis));
            assert_eq!(grid.index(), index, "{millis} ms");
        }
        assert_eq!(grid.next(), Time::VIRTUAL_START + Span::from_seconds(216_001.0 / 60.0));
    }

    #[test]
    fn the_clock_never_runs_back() {
        let first = Time::now();
        assert!(first.is_set() && Time::now() >= first);
    }
}
