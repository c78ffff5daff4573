//! The radio between the host's serial port and the vehicle: pure and seeded, bytes in at one end, bytes out at the other, later,
//! and not all of them, or not as they were.
//!
//! - A byte takes ten bits of the wire's rate; bytes that are handed over together are one frame, and frames queue.
//! - Half duplex: while one end speaks, the other waits.
//! - Every byte arrives by the same latency after its last bit.
//! - A frame is lost as a whole, with one probability; each bit of the others is wrong with another, whatever its neighbours are.
//!
//! Losses and wrong bits are drawn from streams of their own by (seed, way), one draw a frame and one a wrong bit: how bytes are
//! cut into frames does not shift which bits are wrong.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::Wire;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

/// Bits that a byte takes on the wire: start bit, eight bits, stop bit.
const BITS_PER_BYTE: u64 = 10;
/// No more bytes go over the air in one frame: 802.15.4 has no room for more.
const LONGEST_FRAME: usize = 100;
/// Who speaks is asked to wait once so much is queued.
const BACKLOG: Span = Span::from_millis(50);

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the host to the vehicle.
    Up,
    /// From the vehicle to the host.
    Down,
}

/// The radio.
#[derive(Clone, Debug)]
pub struct Radio {
    byte: Span,
    latency: Span,
    half_duplex: bool,
    up: Lane,
    down: Lane,
}

impl Radio {
    /// The radio that `options` describe on a wire of `baud`.
    #[must_use]
    pub fn new(options: &Wire, seed: u64, baud: u32) -> Self {
        let lane = |losses, errors| Lane::new(options, stream(seed, losses), stream(seed, errors));
        // Rounded up: never faster than the wire.
        let nanos = (BITS_PER_BYTE * 1_000_000_000).div_ceil(u64::from(baud.max(1)));
        Self {
            byte: Span::from_nanos(nanos.cast_signed()),
            latency: Span::from_seconds(options.latency_ms * 1e-3),
            half_duplex: options.half_duplex,
            up: lane(RandomSource::UplinkLoss, RandomSource::UplinkErrors),
            down: lane(RandomSource::DownlinkLoss, RandomSource::DownlinkErrors),
        }
    }

    /// Takes bytes that are handed to the wire together.
    pub fn send(&mut self, way: Way, now: Time, bytes: &[u8]) {
        for frame in bytes.chunks(LONGEST_FRAME) {
            let start = now.max(self.free_at(way));
            let byte = self.byte;
            self.lane_mut(way).send(start, byte, frame);
        }
    }

    /// Appends the bytes to `out` that have arrived by `now`.
    pub fn receive(&mut self, way: Way, now: Time, out: &mut Vec<u8>) {
        let (byte, sent_by) = (self.byte, now - self.latency);
        self.lane_mut(way).receive(sent_by, byte, out);
    }

    /// When the next frame that way has arrived whole.
    #[must_use]
    pub fn next_arrival(&self, way: Way) -> Option<Time> {
        self.lane(way).frames.front().map(|frame| frame.end + self.latency)
    }

    /// Whether the wire takes more; else whoever speaks should wait.
    #[must_use]
    pub fn has_room(&self, way: Way, now: Time) -> bool {
        self.free_at(way) <= now + BACKLOG
    }

    /// What went that way so far.
    #[must_use]
    pub fn traffic(&self, way: Way) -> Traffic {
        self.lane(way).traffic
    }

    /// When what is queued has gone; half duplex, whichever way.
    fn free_at(&self, way: Way) -> Time {
        match self.half_duplex {
            true => self.up.free_at.max(self.down.free_at),
            false => self.lane(way).free_at,
        }
    }

    fn lane(&self, way: Way) -> &Lane {
        match way {
            Way::Up => &self.up,
            Way::Down => &self.down,
        }
    }

    fn lane_mut(&mut self, way: Way) -> &mut Lane {
        match way {
            Way::Up => &mut self.up,
            Way::Down => &mut self.down,
        }
    }
}

/// What went one way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Frames handed over.
    pub frames: u64,
    /// Those that were lost.
    pub lost: u64,
    /// Bytes handed over.
    pub bytes: u64,
    /// Bits that were turned round, those of lost frames included.
    pub wrong_bits: u64,
}

/// A frame on its way.
#[derive(Clone, Copy, Debug)]
struct Frame {
    start: Time,
    end: Time,
    bytes: usize,
    arrived: usize,
    lost: bool,
}

/// One way.
#[derive(Clone, Debug)]
struct Lane {
    loss_probability: f64,
    losses: Generator,
    errors: Errors,
    free_at: Time,
    frames: VecDeque<Frame>,
    bytes: VecDeque<u8>,
    traffic: Traffic,
}

impl Lane {
    fn new(options: &Wire, losses: Generator, errors: Generator) -> Self {
        Self {
            loss_probability: options.loss_probability,
            losses,
            errors: Errors::new(options.bit_error_rate, errors),
            free_at: Time::UNSET,
            frames: VecDeque::with_capacity(64),
            bytes: VecDeque::with_capacity(1024),
            traffic: Traffic::default(),
        }
    }

    fn send(&mut self, start: Time, byte: Span, bytes: &[u8]) {
        let draw: f64 = self.losses.random();
        let lost = draw < self.loss_probability;
        let end = start + Span::from_nanos(byte.nanos() * bytes.len() as i64);
        self.frames.push_back(Frame { start, end, bytes: bytes.len(), arrived: 0, lost });
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
            let fresh = sent.min(frame.bytes) - frame.arrived;
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

/// Which bits are wrong: the distances between them, drawn one by one.
#[derive(Clone, Debug)]
struct Errors {
    distance: Geometric,
    generator: Generator,
    /// Right bits before the next wrong one.
    right: u64,
}

impl Errors {
    fn new(rate: f64, mut generator: Generator) -> Self {
        let distance = Geometric::new(rate).expect("the configuration was checked");
        let right = distance.sample(&mut generator);
        Self { distance, generator, right }
    }

    /// The wrong bits of the byte that comes next.
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
