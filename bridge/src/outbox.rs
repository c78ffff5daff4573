//! Frame being sent, and the state of its port.
//!
//! A frame that a port takes only in part is finished before another begins. If a frame is blocked for longer than a period, it is
//! discarded with the contents of the port: otherwise an old command could be sent when the receiver resumes. The vehicle then receives a
//! truncated frame, whose checksum fails, and finds the next frame by its header; it may also take the next frame for the missing rest and
//! lose it. That next frame is therefore a zero set-point.
//!
//! A port may also accept frames without sending them, while the receiver blocks it by flow control. No further frame is then handed over,
//! and contents older than a period are discarded: commands cannot queue up and be sent late.

use oqtal_bus::time::{Span, Time};

use crate::line::LineOccupancy;
use crate::protocol::VehicleFrame;
use crate::safety::ForwardedCommand;

/// Time after which a write is tried again on a port that took nothing or part of a frame.
const RETRY: Span = Span::from_millis(1);
/// Backlog of a port beyond the computed occupancy above which no frame is handed over \[set-points\].
const BACKLOG_SETPOINTS: f64 = 0.5;

/// Content of a frame being sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameKind {
    /// Set-point, and the command that it forwards for the first time.
    Setpoint(Option<ForwardedCommand>),
    /// Periodic frame of the protocol.
    Periodic {
        /// Whether the vehicle answers it.
        is_answered: bool,
    },
    /// Emergency stop of the motors.
    EmergencyStop,
}

/// Frame that was begun.
#[derive(Clone, Copy, Debug)]
struct Outgoing {
    kind: FrameKind,
    frame: VehicleFrame,
    handed_over: usize,
    begun: Time,
}

/// Frame being sent, and the occupancy of the line behind the port.
#[derive(Debug)]
pub struct Outbox {
    line: LineOccupancy,
    /// Time that a set-point occupies the line.
    setpoint: Span,
    period: Span,
    outgoing: Option<Outgoing>,
    /// Instant since which the port holds back more than the computed backlog.
    held_since: Option<Time>,
}

impl Outbox {
    /// Empty outbox before `line`, for set-points of `setpoint_bytes` every `period`.
    pub fn new(line: LineOccupancy, setpoint_bytes: usize, period: Span) -> Self {
        let setpoint = line.time_for(setpoint_bytes);
        Self { line, setpoint, period, outgoing: None, held_since: None }
    }

    /// Discards the frame and everything that the port holds.
    pub fn clear(&mut self) {
        (self.outgoing, self.held_since) = (None, None);
        self.line.clear();
    }

    /// Whether no frame is on its way.
    pub fn is_empty(&self) -> bool {
        self.outgoing.is_none()
    }

    /// Whether no other frame may begin: one is on its way, or the port holds bytes back.
    pub fn is_blocked(&self) -> bool {
        self.outgoing.is_some() || self.held_since.is_some()
    }

    /// Instant at which a blocked port is tried again; `None` if it is not blocked.
    pub fn retry_at(&self, now: Time) -> Option<Time> {
        self.is_blocked().then(|| now + RETRY)
    }

    /// Begins a frame at `now`.
    pub fn begin(&mut self, now: Time, kind: FrameKind, frame: VehicleFrame) {
        self.outgoing = Some(Outgoing { kind, frame, handed_over: 0, begun: now });
    }

    /// Bytes to write to the port: the rest of the frame being sent.
    pub fn bytes(&self) -> &[u8] {
        self.outgoing
            .as_ref()
            .map_or(&[], |outgoing| &outgoing.frame.bytes()[outgoing.handed_over..])
    }

    /// Records that the port took `bytes` at `now`. With the last byte of a frame, returns its kind and the time until that byte
    /// has left.
    pub fn handed_over(&mut self, now: Time, bytes: usize) -> Option<(FrameKind, Span)> {
        let outgoing = self.outgoing.as_mut()?;
        outgoing.handed_over += bytes;
        let length = outgoing.frame.bytes().len();
        if outgoing.handed_over < length {
            return None;
        }
        let kind = outgoing.kind;
        self.outgoing = None;
        Some((kind, self.line.add(now, length)))
    }

    /// Records `bytes` that another process handed over at `at`; returns the time until the last of them has left.
    pub fn add(&mut self, at: Time, bytes: usize) -> Span {
        self.line.add(at, bytes)
    }

    /// Whether all bytes handed over must be discarded: a frame has not been taken completely, or the port, which has still to send
    /// `queued` bytes, has held bytes back, for longer than a period.
    pub fn is_stuck(&mut self, now: Time, queued: usize) -> bool {
        let tolerated = self.line.ahead(now) + self.setpoint.scaled(BACKLOG_SETPOINTS);
        let holds_back = self.line.time_for(queued) > tolerated;
        let free_at = self.line.free_at();
        // No frame follows once bytes are held back, so the time counts from the end of the last one.
        let since = if free_at.is_set() { free_at.min(now) } else { now };
        self.held_since = holds_back.then(|| self.held_since.unwrap_or(since));
        let is_overdue = |since: Time| now.since(since) > self.period;
        self.held_since.is_some_and(is_overdue)
            || self.outgoing.is_some_and(|outgoing| is_overdue(outgoing.begun))
    }

    /// Time until everything handed over has left.
    pub fn ahead(&self, now: Time) -> Span {
        self.line.ahead(now)
    }

    /// Time that `bytes` occupy the line.
    pub fn time_for(&self, bytes: usize) -> Span {
        self.line.time_for(bytes)
    }

    /// Instant at which the backlog of the line falls to one set-point. Until then a waiting command can still be replaced by a
    /// newer one.
    pub fn clear_at(&self, now: Time) -> Time {
        now + (self.line.ahead(now) - self.setpoint).max(Span::ZERO)
    }
}
