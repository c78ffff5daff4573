//! The gate of frames: numbers them without repetition, counts lost, repeated, out-of-order and late ones, and dates the
//! accepted ones. Pure.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{ReceiverOptions, StampSource};

use crate::clock::{CaptureTime, ClockState, ServerClock, StampVerdict};

/// Frames in a row with a restarted, rising count, after which the server counts as restarted.
const RENUMBERED: u32 = 5;
/// Greatest loss; a number further ahead belongs to a new count \[frames\].
const MAX_LOSS: u64 = 1000;

/// Number and stamp of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameStamp {
    /// Number of the frame by the server's count; `None` without a count.
    pub number: Option<u32>,
    /// Instant of capture on the server's clock \[ns\]; `None` without a stamp.
    pub stamp_ns: Option<u64>,
}

/// Accepted frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DatedFrame {
    /// Number, from 1: a gap is a loss \[-\].
    pub frame: u64,
    /// Instant of capture on our clock.
    pub captured: CaptureTime,
}

/// Reason why a frame is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameRefusal {
    /// The frame was received before.
    Repeated,
    /// A later frame was received before.
    OutOfOrder,
    /// The server's clock is not yet known.
    Learning,
    /// The stamp of the frame contradicts the server's clock.
    Contradiction,
    /// The frame was delayed for too long.
    Late,
}

/// Numbers of frames by outcome \[-\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Frames that arrived.
    pub arrived: u64,
    /// Frames that never arrived, by the server's numbers.
    pub lost: u64,
    /// Frames that arrived twice.
    pub repeated: u64,
    /// Frames that arrived after a later one.
    pub out_of_order: u64,
    /// Frames without a capture time, because the server's clock is not known.
    pub undated: u64,
    /// Frames whose stamp contradicts the server's clock.
    pub contradicting: u64,
    /// Frames that were delayed for too long.
    pub late: u64,
    /// Number of restarts of the server's count.
    pub restarts: u64,
}

impl FrameCounts {
    /// The sums of both.
    pub fn plus(self, other: Self) -> Self {
        Self {
            arrived: self.arrived + other.arrived,
            lost: self.lost + other.lost,
            repeated: self.repeated + other.repeated,
            out_of_order: self.out_of_order + other.out_of_order,
            undated: self.undated + other.undated,
            contradicting: self.contradicting + other.contradicting,
            late: self.late + other.late,
            restarts: self.restarts + other.restarts,
        }
    }
}

/// The gate of the frames of one server, or of one body if each body has its own stamps.
#[derive(Clone, Debug)]
pub struct FrameGate {
    clock: ServerClock,
    stamps: StampSource,
    latency: Span,
    max_delay: Span,
    counts: FrameCounts,
    /// Number of the last frame that was in order.
    last: Option<u32>,
    /// Numbers before `last` in a row, and the last of them.
    renumbered: (u32, u32),
    frame: u64,
}

impl FrameGate {
    /// The gate of `[receiver]`.
    pub fn new(options: &ReceiverOptions) -> Self {
        let latency = Span::from_seconds(options.camera_latency_ms * 1e-3);
        Self {
            clock: ServerClock::new(latency),
            stamps: options.stamps,
            latency,
            max_delay: Span::from_seconds(options.max_delay_ms * 1e-3),
            counts: FrameCounts::default(),
            last: None,
            renumbered: (0, 0),
            frame: 0,
        }
    }

    /// Discards the server's clock and its count. The numbering of accepted frames continues.
    pub fn forget(&mut self) {
        self.clock.forget();
        self.last = None;
        self.renumbered = (0, 0);
    }

    /// Checks a frame that arrived at `arrival`. Frames are given in the order of their arrival.
    ///
    /// # Errors
    /// The frame is rejected.
    pub fn check(&mut self, stamp: FrameStamp, arrival: Time) -> Result<DatedFrame, FrameRefusal> {
        self.counts.arrived += 1;
        let result = self.number(stamp.number).and_then(|()| self.date(stamp.stamp_ns, arrival));
        let counted = match result {
            Ok(captured) if captured.delay <= self.max_delay => {
                return Ok(DatedFrame { frame: self.frame, captured });
            }
            Ok(_) => (&mut self.counts.late, FrameRefusal::Late),
            Err(FrameRefusal::Repeated) => (&mut self.counts.repeated, FrameRefusal::Repeated),
            Err(FrameRefusal::OutOfOrder) => {
                (&mut self.counts.out_of_order, FrameRefusal::OutOfOrder)
            }
            Err(FrameRefusal::Learning) => (&mut self.counts.undated, FrameRefusal::Learning),
            Err(refusal) => (&mut self.counts.contradicting, refusal),
        };
        *counted.0 += 1;
        Err(counted.1)
    }

    /// The counts so far.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// State of the server's clock.
    pub fn clock(&self) -> ClockState {
        match self.stamps {
            StampSource::Server => self.clock.state(),
            StampSource::Arrival => ClockState { is_known: true, ..ClockState::default() },
        }
    }

    /// Numbers the frame. Without a count of the server, frames are numbered by arrival.
    fn number(&mut self, number: Option<u32>) -> Result<(), FrameRefusal> {
        let (Some(number), Some(last)) = (number, self.last) else {
            self.last = number;
            self.frame += 1;
            return Ok(());
        };
        // Handles 32-bit wrap-around.
        let step = i64::from(number.wrapping_sub(last).cast_signed());
        let step = if step > 0 { step.unsigned_abs() } else { self.restart(number, step)? };
        self.counts.lost += if step <= MAX_LOSS { step - 1 } else { 0 };
        self.last = Some(number);
        self.renumbered = (0, 0);
        self.frame += if step <= MAX_LOSS { step } else { 1 };
        Ok(())
    }

    /// Handles a number that is not after the last one: of a repeated or late frame, or of a restarted count.
    fn restart(&mut self, number: u32, step: i64) -> Result<u64, FrameRefusal> {
        let (count, before) = self.renumbered;
        self.renumbered =
            if count > 0 && number > before { (count + 1, number) } else { (1, number) };
        if self.renumbered.0 < RENUMBERED {
            return Err(if step == 0 { FrameRefusal::Repeated } else { FrameRefusal::OutOfOrder });
        }
        self.counts.restarts += 1;
        Ok(1)
    }

    fn date(&mut self, stamp_ns: Option<u64>, arrival: Time) -> Result<CaptureTime, FrameRefusal> {
        let stamp_ns = match (self.stamps, stamp_ns) {
            (StampSource::Server, Some(stamp_ns)) => stamp_ns,
            // The configuration requires server stamps; an unstamped frame is rejected.
            (StampSource::Server, None) => return Err(FrameRefusal::Contradiction),
            (StampSource::Arrival, _) => {
                let captured_at = arrival - self.latency;
                let uncertainty = Span::ZERO;
                return Ok(CaptureTime { captured_at, uncertainty, delay: Span::ZERO });
            }
        };
        match self.clock.observe(stamp_ns, arrival) {
            StampVerdict::Known(captured) => Ok(captured),
            StampVerdict::Learning => Err(FrameRefusal::Learning),
            StampVerdict::Contradiction => Err(FrameRefusal::Contradiction),
        }
    }
}
