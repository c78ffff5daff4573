//! Telemetry of the emulated autopilot: schedule of its messages.

use oqtal_bus::time::{Span, Time};

use crate::wire::schedule::MessageSchedule;

/// Period of messages that are sent without request.
const DEFAULT_PERIOD: Span = Span::from_millis(1000);
/// Shortest period of a message.
const SHORTEST_PERIOD: Span = Span::from_millis(2);

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

    /// Stream of the message `number`; the estimator reports of both autopilots share one stream.
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

/// Schedules of the streams, and streams of which one further message was requested.
#[derive(Clone, Debug)]
pub(super) struct TelemetryStreams {
    /// Schedule by stream; `None` for a stream that is not sent.
    schedules: [Option<MessageSchedule>; COUNT],
    requested: [bool; COUNT],
}

impl TelemetryStreams {
    /// Heartbeat and battery, once a second from `started`.
    pub(super) fn new(started: Time) -> Self {
        let default = Some(MessageSchedule::new(started, DEFAULT_PERIOD));
        Self { schedules: [default, default, None, None, None], requested: [false; COUNT] }
    }

    /// Sends the message `number` every `interval_us` from `now`; returns whether it is known.
    pub(super) fn set(&mut self, now: Time, number: u32, interval_us: u32) -> bool {
        let Some(stream) = Stream::of(number) else { return false };
        let period = Span::from_nanos(i64::from(interval_us) * 1000).max(SHORTEST_PERIOD);
        self.schedules[stream as usize] = Some(MessageSchedule::new(now, period));
        true
    }

    /// Sends the message `number` once more, at once; returns whether it is known.
    pub(super) fn request(&mut self, number: u32) -> bool {
        let Some(stream) = Stream::of(number) else { return false };
        self.requested[stream as usize] = true;
        true
    }

    /// Instant at which the next message is due.
    pub(super) fn next_event(&self) -> Option<Time> {
        self.schedules.iter().flatten().map(MessageSchedule::next).min()
    }

    /// The messages that are due at `now`, in the order of [`Stream::ALL`].
    pub(super) fn due(&mut self, now: Time) -> impl Iterator<Item = Stream> + use<> {
        let is_due: [bool; COUNT] = std::array::from_fn(|index| {
            let is_scheduled = self.schedules[index].as_mut().is_some_and(|s| s.is_due(now));
            std::mem::take(&mut self.requested[index]) || is_scheduled
        });
        Stream::ALL.into_iter().zip(is_due).filter(|(_, is_due)| *is_due).map(|(stream, _)| stream)
    }
}
