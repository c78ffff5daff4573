//! Transit of a pose from the cameras to this machine: the camera computer forwards the newest frame at its own ticks, the
//! connection stalls at times, the receiver polls.

use oqtal_bus::time::{Span, Time};
use oqtal_config::MocapOptions;
use oqtal_runtime::random::Generator;
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

/// Frame sent by the camera computer.
#[derive(Clone, Copy, Debug)]
pub struct SentFrame {
    /// Number of the frame among the frames sent, from 1 \[-\].
    pub number: u64,
    /// Instant at which it is sent.
    pub at: Time,
}

/// Camera computer: selects the frames that are sent, and their instants.
#[derive(Clone, Debug)]
pub struct FrameSender {
    mocap: MocapOptions,
    /// The next tick, nominal and with its lateness; `None` before the first frame.
    next: Option<(Time, Time)>,
    sent: u64,
}

impl FrameSender {
    /// Camera computer of a configuration.
    pub fn new(mocap: &MocapOptions) -> Self {
        Self { mocap: mocap.clone(), next: None, sent: 0 }
    }

    /// Sends the frame `number`, captured at `captured_at`, if a tick finds it the newest one; with `RoomFrame::sending`.
    pub fn send(
        &mut self,
        number: u64,
        captured_at: Time,
        [skip, late, lateness]: [f64; 3],
    ) -> Option<SentFrame> {
        let room = &self.mocap.room;
        if room.send_period_ms == 0.0 {
            return Some(SentFrame { number, at: captured_at });
        }
        let (tick, at) = self.next.unwrap_or((captured_at, captured_at));
        let following = captured_at + Span::period_of(self.mocap.rate_hz);
        if at >= following {
            self.next = Some((tick, at));
            return None;
        }
        // After a missed period the lateness is halved, as measured in recordings.
        let (periods, haste) =
            if skip < room.send_skip_probability { (2.0, 0.5) } else { (1.0, 1.0) };
        let tick = tick + Span::from_seconds(periods * room.send_period_ms * 1e-3);
        let is_late = late < room.send_late_probability;
        let lateness_ms = if is_late { haste * lateness * room.send_late_ms } else { 0.0 };
        self.next = Some((tick, tick + Span::from_seconds(lateness_ms * 1e-3)));
        self.sent += 1;
        Some(SentFrame { number: self.sent, at: at.max(captured_at) })
    }
}

/// Connection from the camera computer, with its stalls.
#[derive(Clone, Debug)]
pub struct Transit {
    mocap: MocapOptions,
    /// End of the present or last stall, and whether the poses in it are lost.
    stalled_until: Time,
    loses: bool,
    /// Number of frames left in the current dropout.
    gap: u64,
    last_arrival: Time,
}

impl Transit {
    /// Connection of a configuration.
    pub fn new(mocap: &MocapOptions) -> Self {
        Self {
            mocap: mocap.clone(),
            stalled_until: Time::UNSET,
            loses: false,
            gap: 0,
            last_arrival: Time::UNSET,
        }
    }

    /// Greatest number of poses in transit at once \[-\].
    pub fn capacity(&self) -> usize {
        let MocapOptions { room, .. } = &self.mocap;
        let longest_ms = self.mocap.latency_ms + self.mocap.jitter_ms + self.mocap.poll_ms;
        let stall_ms = if room.stalls_per_1000_s > 0.0 { 3.0 * room.stall_to_ms } else { 0.0 };
        ((longest_ms + stall_ms) * 1e-3 * self.mocap.rate_hz) as usize + 2
    }

    /// Whether the connection loses this frame. Dropouts begin at random and have geometrically distributed lengths.
    pub fn loses_frame(&mut self, generator: &mut Generator) -> bool {
        let begins: f64 = generator.random();
        if self.gap == 0 && begins < self.mocap.dropout_probability {
            let further = Geometric::new(1.0 / self.mocap.dropout_frames)
                .map_or(0, |length| length.sample(generator));
            self.gap = 1 + further;
        }
        let lost = self.gap > 0;
        self.gap = self.gap.saturating_sub(1);
        lost
    }

    /// Starts a stall at `now` at random, by `RoomFrame::stall`; to be called once per camera frame.
    pub fn advance(&mut self, now: Time, [begins, length, loses]: [f64; 3]) {
        let room = &self.mocap.room;
        let probability = room.stalls_per_1000_s * 1e-3 / self.mocap.rate_hz;
        if now >= self.stalled_until && begins < probability {
            let ratio = room.stall_to_ms / room.stall_from_ms;
            let stall_ms = room.stall_from_ms * ratio.powf(length);
            self.stalled_until = now + Span::from_seconds(stall_ms * 1e-3);
            self.loses = loses < room.stall_loss_probability;
        }
    }

    /// Arrival of a pose that is sent at `sent_at` and takes `latency`; `None` if it is lost in a stall. Poses share one
    /// connection and keep their order; poses behind a late one arrive with it, as a burst, `RoomFrame::spacing` apart.
    pub fn arrival(&mut self, sent_at: Time, latency: Span, spacing: f64) -> Option<Time> {
        let spacing_ms = 2.0 * spacing * self.mocap.room.queue_spacing_ms;
        let arrival = sent_at + latency;
        let is_stalled = arrival < self.stalled_until;
        if is_stalled && self.loses {
            return None;
        }
        let queue = self.last_arrival + Span::from_seconds(spacing_ms * 1e-3);
        let is_queued = is_stalled || (self.last_arrival > arrival && self.stalled_until > sent_at);
        let arrival = if is_queued {
            queue.max(self.stalled_until)
        } else {
            self.polled(arrival).max(self.last_arrival)
        };
        self.last_arrival = arrival;
        Some(arrival)
    }

    /// First polling instant of the receiver (`mocap.poll-ms`) not before `arrival`.
    fn polled(&self, arrival: Time) -> Time {
        let period = Span::from_seconds(self.mocap.poll_ms * 1e-3).nanos().unsigned_abs();
        if period == 0 {
            return arrival;
        }
        Time::from_nanos(arrival.nanos().div_ceil(period) * period)
    }
}
