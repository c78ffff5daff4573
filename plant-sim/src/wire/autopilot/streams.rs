//! Telemetry of the emulated autopilot: which messages are sent, and how often.

use oqtal_bus::time::{Span, Time};

/// Rates that are sent without being asked for.
const SELDOM: Span = Span::from_millis(1000);
/// Shortest time between two messages of a kind.
const SHORTEST: Span = Span::from_millis(2);

/// Message of telemetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stream {
    Heartbeat,
    Battery,
    Attitude,
    Position,
    Estimator,
}

/// Number of streams \[-\].
const COUNT: usize = 5;

impl Stream {
    const ALL: [Self; COUNT] =
        [Self::Heartbeat, Self::Battery, Self::Attitude, Self::Position, Self::Estimator];

    /// The stream of the message `number`; both autopilots' reports of the estimator are one.
    fn of(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::Heartbeat),
            1 => Some(Self::Battery),
            31 => Some(Self::Attitude),
            32 => Some(Self::Position),
            193 | 230 => Some(Self::Estimator),
            _ => None,
        }
    }
}

/// Rate of a stream, and when it is due.
#[derive(Clone, Copy, Debug)]
struct Cadence {
    interval: Span,
    next: Time,
}

/// The streams, `None` for one that is not sent; and those of which one more message was asked for.
#[derive(Clone, Debug)]
pub(super) struct TelemetryStreams([Option<Cadence>; COUNT], [bool; COUNT]);

impl TelemetryStreams {
    /// Heartbeat and battery, once a second from `started`.
    pub(super) fn new(started: Time) -> Self {
        let seldom = Some(Cadence { interval: SELDOM, next: started });
        Self([seldom, seldom, None, None, None], [false; COUNT])
    }

    /// Sends the message `number` every `interval_us` from `now`; returns whether it is known.
    pub(super) fn set(&mut self, now: Time, number: u32, interval_us: u32) -> bool {
        let Some(stream) = Stream::of(number) else { return false };
        let interval = Span::from_nanos(i64::from(interval_us) * 1000).max(SHORTEST);
        self.0[stream as usize] = Some(Cadence { interval, next: now });
        true
    }

    /// Sends the message `number` once more, at once; returns whether it is known.
    pub(super) fn request(&mut self, number: u32) -> bool {
        let Some(stream) = Stream::of(number) else { return false };
        self.1[stream as usize] = true;
        true
    }

    /// Instant at which the next message is due.
    pub(super) fn next_event(&self) -> Time {
        let due = self.0.iter().flatten().map(|cadence| cadence.next);
        due.reduce(Time::min).unwrap_or(Time::UNSET)
    }

    /// The messages that are due at `now`.
    pub(super) fn due(&mut self, now: Time) -> [Option<Stream>; COUNT] {
        let mut due = [None; COUNT];
        for (index, stream) in Stream::ALL.iter().enumerate() {
            if std::mem::take(&mut self.1[index]) {
                due[index] = Some(*stream);
            }
        }
        for ((stream, cadence), place) in Stream::ALL.iter().zip(&mut self.0).zip(&mut due) {
            let Some(cadence) = cadence.as_mut().filter(|cadence| cadence.next <= now) else {
                continue;
            };
            *place = Some(*stream);
            // Messages that were missed are not made up for.
            cadence.next = (cadence.next + cadence.interval).max(now);
        }
        due
    }
}
