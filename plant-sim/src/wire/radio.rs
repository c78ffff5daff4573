//! Model of the radio between the host's serial port and the vehicle: bytes are delayed, some are lost, some arrive wrong. Pure
//! and seeded.
//!
//! - A byte takes ten bits at the rate of the wire; bytes sent together form one frame, and frames queue.
//! - Half duplex: while one end sends, the other one waits.
//! - Every byte arrives with the same latency after its last bit.
//! - A frame is lost as a whole with one probability; each bit of the other frames is wrong with another, independently.
//!
//! Losses and wrong bits are drawn from separate random streams by (seed, direction), one draw per frame and one per wrong bit:
//! the division into frames does not change which bits are wrong.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::PlantWireOptions;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

use super::link::{LinkDirection, LinkModel, Traffic};

/// Bits of one byte on the wire: start bit, eight data bits, stop bit.
const BITS_PER_BYTE: u64 = 10;
/// Longest frame over the air \[bytes\], as 802.15.4 limits it.
const LONGEST_FRAME: usize = 100;
/// High-water mark of the send queue; above it the sender is paused.
const BACKLOG: Span = Span::from_millis(50);
/// Longest time for which a frame of the vehicle waits for its transmission. The vehicle cannot be paused: a host that requests more
/// replies than the radio transmits loses the excess.
const LONGEST_WAIT: Span = Span::from_millis(1000);

/// Model of the radio.
#[derive(Clone, Debug)]
pub struct RadioModel {
    byte: Span,
    latency: Span,
    half_duplex: bool,
    /// Lanes, indexed by [`LinkDirection`].
    lanes: [Lane; 2],
    /// Latency added by faults.
    delay: Span,
}

impl RadioModel {
    /// Radio of `options` on a wire at `baud`.
    pub fn new(options: &PlantWireOptions, seed: u64, baud: u32) -> Self {
        let lane = |losses, errors| Lane::new(options, stream(seed, losses), stream(seed, errors));
        // Rounded up, so that the model is never faster than the wire.
        let nanos = (BITS_PER_BYTE * 1_000_000_000).div_ceil(u64::from(baud.max(1)));
        Self {
            byte: Span::from_nanos(nanos.cast_signed()),
            latency: Span::from_seconds(options.latency_ms * 1e-3),
            half_duplex: options.half_duplex,
            lanes: [
                lane(RandomSource::UplinkLoss, RandomSource::UplinkErrors),
                lane(RandomSource::DownlinkLoss, RandomSource::DownlinkErrors),
            ],
            delay: Span::ZERO,
        }
    }

    /// Instant at which the queue is empty; in half duplex, of both directions.
    fn free_at(&self, direction: LinkDirection) -> Time {
        let [up, down] = [&self.lanes[0], &self.lanes[1]].map(|lane| lane.free_at);
        if self.half_duplex { up.max(down) } else { self.lanes[direction as usize].free_at }
    }
}

impl LinkModel for RadioModel {
    fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.delay = disturbance.delay;
        for lane in &mut self.lanes {
            lane.disturbed_loss_probability = disturbance.loss_probability;
        }
    }

    fn send(&mut self, direction: LinkDirection, now: Time, bytes: &[u8]) {
        for frame in bytes.chunks(LONGEST_FRAME) {
            let start = now.max(self.free_at(direction));
            let lane = &mut self.lanes[direction as usize];
            if direction == LinkDirection::Down && start > now + LONGEST_WAIT {
                lane.traffic.frames += 1;
                lane.traffic.lost += 1;
            } else {
                lane.send(start, self.byte, frame);
            }
        }
    }

    fn receive(&mut self, direction: LinkDirection, now: Time, out: &mut Vec<u8>) -> bool {
        let (sent_by, before) = (now - self.latency - self.delay, out.len());
        self.lanes[direction as usize].receive(sent_by, self.byte, out);
        out.len() > before
    }

    fn next_arrival(&self, direction: LinkDirection) -> Option<Time> {
        let frame = self.lanes[direction as usize].frames.front();
        frame.map(|frame| frame.end + self.latency + self.delay)
    }

    fn has_room(&self, direction: LinkDirection, now: Time) -> bool {
        self.free_at(direction) <= now + BACKLOG
    }

    fn traffic(&self, direction: LinkDirection) -> Traffic {
        self.lanes[direction as usize].traffic
    }
}

/// Frame in transit.
#[derive(Clone, Copy, Debug)]
struct QueuedFrame {
    start: Time,
    end: Time,
    bytes: usize,
    arrived: usize,
    lost: bool,
}

/// One direction of the radio.
#[derive(Clone, Debug)]
struct Lane {
    loss_probability: f64,
    /// Loss probability added by faults \[0..1\].
    disturbed_loss_probability: f64,
    losses: Generator,
    errors: BitErrors,
    free_at: Time,
    frames: VecDeque<QueuedFrame>,
    bytes: VecDeque<u8>,
    traffic: Traffic,
}

impl Lane {
    fn new(options: &PlantWireOptions, losses: Generator, errors: Generator) -> Self {
        Self {
            loss_probability: options.loss_probability,
            disturbed_loss_probability: 0.0,
            losses,
            errors: BitErrors::new(options.bit_error_rate, errors),
            free_at: Time::UNSET,
            frames: VecDeque::with_capacity(64),
            bytes: VecDeque::with_capacity(1024),
            traffic: Traffic::default(),
        }
    }

    fn send(&mut self, start: Time, byte: Span, bytes: &[u8]) {
        let draw: f64 = self.losses.random();
        let lost = draw < self.loss_probability.max(self.disturbed_loss_probability);
        let end = start + Span::from_nanos(byte.nanos() * bytes.len() as i64);
        self.frames.push_back(QueuedFrame { start, end, bytes: bytes.len(), arrived: 0, lost });
        self.free_at = end;
        self.traffic.frames += 1;
        self.traffic.lost += u64::from(lost);
        self.traffic.bytes += bytes.len() as u64;
        for &byte in bytes {
            let wrong = self.errors.next_byte();
            self.traffic.wrong_bits += u64::from(wrong.count_ones());
            self.bytes.push_back(byte ^ wrong);
        }
    }

    fn receive(&mut self, sent_by: Time, byte: Span, out: &mut Vec<u8>) {
        while let Some(frame) = self.frames.front_mut() {
            let sent = (sent_by.since(frame.start).nanos() / byte.nanos()).max(0) as usize;
            // A delay that has grown since withdraws no byte.
            let fresh = sent.min(frame.bytes).saturating_sub(frame.arrived);
            frame.arrived += fresh;
            let (lost, whole) = (frame.lost, frame.arrived == frame.bytes);
            let bytes = self.bytes.drain(..fresh);
            if !lost {
                out.extend(bytes);
            }
            if !whole {
                return;
            }
            self.frames.pop_front();
        }
    }
}

/// Generator of wrong bits, which draws the distances between them.
#[derive(Clone, Debug)]
struct BitErrors {
    distance: Geometric,
    generator: Generator,
    /// Number of correct bits before the next wrong one \[bits\].
    right: u64,
}

impl BitErrors {
    fn new(rate: f64, mut generator: Generator) -> Self {
        let distance = Geometric::new(rate).expect("the configuration was checked");
        let right = distance.sample(&mut generator);
        Self { distance, generator, right }
    }

    /// Mask of the wrong bits of the next byte.
    fn next_byte(&mut self) -> u8 {
        let (mut wrong, mut bit) = (0, 0);
        while self.right < 8 - bit {
            bit += self.right;
            wrong |= 1 << bit;
            bit += 1;
            self.right = self.distance.sample(&mut self.generator);
        }
        self.right -= 8 - bit;
        wrong
    }
}
