//! Estimate of a camera server's clock: converts its stamps to instants of capture on the monotonic clock of this machine.
//!
//! A server stamps its frames with its own clock, which differs from ours by an unknown offset and a drift of some parts per million. Only
//! the arrivals of stamped frames are observable, each late by an unknown delay. [`ServerClock`] uses the line below all recent arrivals,
//! [`LowerEnvelope`]: the frames with the shortest delay. The least delay itself cannot be observed here; it is part of the configured
//! `receiver.camera-latency-ms`.
//!
//! A frame whose stamp *contradicts* the line (it arrived before it was captured, or its stamp is not after the last one) is
//! rejected. If contradictions persist, the server's clock was set, and it is estimated again. A longer delay of any duration is
//! not a contradiction: such frames are old. A step back of the clock differs from it only in the stamps; [`StepWatch`] detects
//! it. [`LoweringWatch`] detects a small step forward. After a small step in either direction, only the pairs before it are
//! discarded, so that poses continue.

mod envelope;
mod lowering;
mod step;

use oqtal_bus::time::{Span, Time};

pub use envelope::{EnvelopeLine, LowerEnvelope, MAX_DRIFT, StampPair};
pub use lowering::LoweringWatch;
pub use step::{StepHypothesis, StepWatch};

/// Shortest time over which a clock is estimated.
const LEARNING_TIME: Span = Span::from_millis(500);
/// Least number of frames from which a clock is estimated \[-\].
const LEARNING_FRAMES: u32 = 12;
/// Limit of the time by which a frame arrives before the line, or by which stamps contract: from it on the server's clock counts as set; a
/// shorter time only corrects the line.
const IMPOSSIBLE: Span = Span::from_millis(25);
/// Least lowering of the line within a second by which all earlier pairs are discarded.
const SMALL_STEP: Span = Span::from_millis(1);
/// Time after the start of the estimate, or after a step, in which lowerings of the line are not counted: few fast frames have
/// arrived yet.
const SETTLING_TIME: Span = Span::from_millis(2000);
/// Contradictions in a row, and the time that they span, after which the server's clock counts as set.
const CONTRADICTIONS: u32 = 5;
const CONTRADICTION_TIME: Span = Span::from_millis(100);
/// Silence after which the clock is unknown: the server may have been restarted.
const SILENCE: Span = Span::from_millis(1000);
/// Bound of the error of the line in 99 of 100 cases, in mean delays divided by the number of frames \[-\]. Found by simulation with
/// uniform and exponential delays; the tests verify it.
const UNCERTAINTY_FACTOR: f64 = 40.0;

/// An instant of capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureTime {
    /// The instant, never after the arrival.
    pub captured_at: Time,
    /// Error of the instant that is not exceeded in 99 of 100 frames, without the least one-way delay, which cannot be observed.
    pub uncertainty: Span,
    /// Delay of this frame beyond the least one.
    pub delay: Span,
}

/// Result for a frame's instant of capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StampVerdict {
    /// The instant is known.
    Known(CaptureTime),
    /// The server's clock is not yet known.
    Learning,
    /// The stamp contradicts the known clock.
    Contradiction,
}

/// State of the clock, for log and status.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClockState {
    /// Whether capture times are known.
    pub is_known: bool,
    /// Number of times the clock was estimated again, the first time excluded \[-\].
    pub relearned: u64,
    /// Our clock minus the server's at the last frame \[ns\], the least delay included.
    pub offset_ns: i64,
    /// Rate of our clock against the server's \[ppm\].
    pub drift_ppm: f64,
    /// Like [`CaptureTime::uncertainty`].
    pub uncertainty: Span,
}

/// Estimator of a server's clock. Pure; bounded work and no allocation for each frame.
#[derive(Clone, Debug)]
pub struct ServerClock {
    /// Time from the capture to the arrival of the fastest frames.
    latency: Span,
    envelope: LowerEnvelope,
    /// The first pair of the estimate: all others are relative to it, stamp and arrival \[ns\].
    origin: Option<(u64, Time)>,
    last: (u64, Time),
    contradictions: u32,
    contradicted_since: Time,
    /// Stamp of the last contradicting frame \[ns\].
    contradicting_ns: u64,
    steps: StepWatch,
    lowerings: LoweringWatch,
    /// Start of the estimate, or instant at which the last small step was detected.
    settling_since: Time,
    /// Mean delay of the pairs that were discarded after a step \[ns\]: few pairs do not show the scatter.
    scatter_ns: f64,
    known: bool,
    relearned: u64,
}

impl ServerClock {
    /// A clock that is unknown; `latency` passes between the capture of a frame and its arrival at least.
    pub fn new(latency: Span) -> Self {
        Self {
            latency,
            envelope: LowerEnvelope::default(),
            origin: None,
            last: (0, Time::UNSET),
            contradictions: 0,
            contradicted_since: Time::UNSET,
            contradicting_ns: 0,
            steps: StepWatch::default(),
            lowerings: LoweringWatch::default(),
            settling_since: Time::UNSET,
            scatter_ns: 0.0,
            known: false,
            relearned: 0,
        }
    }

    /// Discards the clock, as after a new connection.
    pub fn forget(&mut self) {
        self.envelope.clear();
        self.origin = None;
        self.steps = StepWatch::default();
        self.lowerings = LoweringWatch::default();
        self.scatter_ns = 0.0;
        self.known = false;
        self.contradictions = 0;
    }

    /// The instant of capture of a frame with the server's stamp `stamp_ns` \[ns, server clock\] that arrived at `arrival`. Frames
    /// are given in the order of their arrival, a repeated frame not twice.
    pub fn observe(&mut self, stamp_ns: u64, arrival: Time) -> StampVerdict {
        if self.origin.is_some() && arrival.since(self.last.1) > SILENCE {
            self.forget();
        }
        let step = self.watch_for_step(stamp_ns, arrival);
        let is_great = step.is_some_and(|step| step.contraction_ns > IMPOSSIBLE.nanos());
        let contradicts = is_great || self.contradicts(stamp_ns, arrival);
        if contradicts && !self.is_set_again(stamp_ns, arrival) {
            return StampVerdict::Contradiction;
        }
        self.contradictions = 0;
        let before_ns = std::mem::replace(&mut self.last, (stamp_ns, arrival)).0;
        if self.origin.is_none() {
            self.settling_since = arrival;
        }
        let origin = *self.origin.get_or_insert((stamp_ns, arrival));
        let pair = relative(origin, (stamp_ns, arrival));
        let ahead_ns = self.envelope.line().offset_ns(pair.stamp_ns) - pair.offset_ns;
        self.envelope.add(pair);
        self.watch_for_lowering(before_ns, arrival, ahead_ns);
        let lasting = |step: &StepHypothesis| {
            !is_great && step.has_lasted(arrival, LEARNING_TIME, LEARNING_FRAMES)
        };
        if let Some(step) = step.filter(lasting) {
            self.forget_through(step.stamp_ns);
        }
        self.known = self.known
            || (arrival.since(origin.1) >= LEARNING_TIME
                && self.envelope.count() >= LEARNING_FRAMES);
        if !self.known {
            return StampVerdict::Learning;
        }
        let delay = pair.offset_ns - self.envelope.line().offset_ns(pair.stamp_ns);
        let delay = Span::from_nanos(delay.max(0.0).round() as i64);
        let captured_at = arrival - delay - self.latency;
        StampVerdict::Known(CaptureTime { captured_at, uncertainty: self.uncertainty(), delay })
    }

    /// The state after the last frame.
    pub fn state(&self) -> ClockState {
        let line = self.envelope.line();
        let offset_ns = self.origin.map_or(0, |origin| {
            let at_origin = origin.1.nanos().wrapping_sub(origin.0).cast_signed();
            let since = line.offset_ns(relative(origin, self.last).stamp_ns);
            at_origin.wrapping_add(since.round() as i64)
        });
        ClockState {
            is_known: self.known,
            relearned: self.relearned,
            offset_ns,
            drift_ppm: line.drift * 1e6,
            uncertainty: self.uncertainty(),
        }
    }

    fn uncertainty(&self) -> Span {
        let count = self.envelope.count().max(1);
        let scatter_ns = if count < LEARNING_FRAMES { self.scatter_ns } else { 0.0 };
        let mean_ns = self.envelope.mean_delay_ns().max(scatter_ns);
        let bound_ns = UNCERTAINTY_FACTOR * mean_ns / f64::from(count);
        Span::from_nanos(bound_ns.round() as i64)
    }

    /// Hypothesis of a step back after this frame.
    fn watch_for_step(&mut self, stamp_ns: u64, arrival: Time) -> Option<StepHypothesis> {
        let delay_ns = self.origin.map_or(0.0, |origin| {
            let pair = relative(origin, (stamp_ns, arrival));
            pair.offset_ns - self.envelope.line().offset_ns(pair.stamp_ns)
        });
        self.steps.observe(stamp_ns, arrival, delay_ns)
    }

    /// Discards all pairs from before a quick lowering of the line: no frame is faster than the fastest one, so the clock was set forward,
    /// or the network path has become shorter.
    fn watch_for_lowering(&mut self, before_ns: u64, arrival: Time, ahead_ns: f64) {
        let is_settled = arrival.since(self.settling_since) >= SETTLING_TIME;
        if !self.known || !is_settled || ahead_ns <= 0.0 {
            return;
        }
        if let Some(stamp_ns) = self.lowerings.add(ahead_ns, (before_ns, arrival), SMALL_STEP) {
            self.forget_through(stamp_ns);
        }
    }

    /// Discards the pairs up to this stamp, from before a small step: poses continue with the others.
    fn forget_through(&mut self, stamp_ns: u64) {
        let Some(origin) = self.origin else { return };
        let stamp_ns = stamp_ns.wrapping_sub(origin.0).cast_signed();
        self.scatter_ns = self.envelope.mean_delay_ns();
        self.envelope.forget_through(stamp_ns as f64);
        self.steps.settle();
        self.lowerings = LoweringWatch::default();
        self.settling_since = self.last.1;
        self.relearned += 1;
    }

    /// Whether a stamp is impossible if the clock was not set.
    fn contradicts(&self, stamp_ns: u64, arrival: Time) -> bool {
        let Some(origin) = self.origin else { return false };
        let pair = relative(origin, (stamp_ns, arrival));
        let ahead_ns = self.envelope.line().offset_ns(pair.stamp_ns) - pair.offset_ns;
        stamp_ns <= self.last.0 || ahead_ns > IMPOSSIBLE.nanos() as f64
    }

    /// Counts a contradiction. After enough of them in rising order, the clock is discarded.
    fn is_set_again(&mut self, stamp_ns: u64, arrival: Time) -> bool {
        if self.contradictions == 0 || stamp_ns <= self.contradicting_ns {
            self.contradictions = 0;
            self.contradicted_since = arrival;
        }
        self.contradictions += 1;
        self.contradicting_ns = stamp_ns;
        let lasting = arrival.since(self.contradicted_since) >= CONTRADICTION_TIME;
        let is_set = self.contradictions >= CONTRADICTIONS && lasting;
        if is_set {
            self.relearned += 1;
            self.forget();
        }
        is_set
    }
}

/// The pair of a frame relative to that of the first one.
fn relative(origin: (u64, Time), frame: (u64, Time)) -> StampPair {
    let stamp_ns = frame.0.wrapping_sub(origin.0).cast_signed();
    let arrival_ns = frame.1.since(origin.1).nanos();
    // Subtracted as integers: the difference is small, the stamps need not be.
    let offset_ns = arrival_ns.wrapping_sub(stamp_ns);
    StampPair { stamp_ns: stamp_ns as f64, offset_ns: offset_ns as f64 }
}
