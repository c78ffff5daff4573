//! Decoder of frames in a stream of arbitrary bytes: noise, parts of frames, several frames in one read.
//!
//! A [`Grammar`] defines the start byte of a frame and inspects candidates; the [`Decoder`] holds the bytes. When a candidate is
//! rejected, the search continues at the next start byte *within* it, so that a good frame behind a damaged header is not lost.
//!
//! The work is bounded: a candidate is inspected when the number of bytes required by the grammar is present, and each position
//! begins at most one candidate. Decoding does not allocate, and no input can cause a panic.

use std::marker::PhantomData;

/// Greatest frame length that a grammar may ask for \[bytes\]: a signed MAVLink 2 packet of greatest length.
pub const MAX_FRAME: usize = 280;

/// Capacity of the window \[bytes\]: twice the longest frame, so that bytes are moved to the front at most once per frame.
const CAPACITY: usize = 2 * MAX_FRAME;

/// Result of the inspection of the bytes from a start byte on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict<E> {
    /// Possible frame: inspect again when this number of bytes is present; more than now and at most [`MAX_FRAME`].
    Wait(usize),
    /// Frame of this many bytes, at least one; without an event if it is not used.
    Accept(usize, Option<E>),
    /// Not a frame.
    Noise,
    /// Frame whose length, checksum or end is wrong.
    Damaged,
}

/// Format of frames.
pub trait Grammar {
    /// Content of a frame.
    type Event;

    /// First byte of every frame.
    const START: u8;

    /// Inspects `bytes`, which begin with [`Grammar::START`].
    fn inspect(bytes: &[u8]) -> Verdict<Self::Event>;
}

/// Counters of a decoder since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderCounters {
    /// Good frames, those without an event included \[-\].
    pub frames: u64,
    /// Damaged frames \[-\].
    pub damaged: u64,
    /// Bytes outside good frames \[bytes\].
    pub skipped: u64,
}

/// Decoder of one format.
#[derive(Clone, Debug)]
pub struct Decoder<G> {
    window: [u8; CAPACITY],
    start: usize,
    end: usize,
    wanted: usize,
    counters: DecoderCounters,
    grammar: PhantomData<G>,
}

impl<G> Default for Decoder<G> {
    fn default() -> Self {
        let window = [0; CAPACITY];
        let counters = DecoderCounters::default();
        Self { window, start: 0, end: 0, wanted: 1, counters, grammar: PhantomData }
    }
}

impl<G: Grammar> Decoder<G> {
    /// Decoder without any bytes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes received bytes and returns the events that they complete. Bytes are taken as the iterator advances: run it to its end.
    pub fn push<'a>(&'a mut self, bytes: &'a [u8]) -> DecodedEvents<'a, G> {
        DecodedEvents { decoder: self, bytes }
    }

    /// Counters since the start.
    pub fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Number of bytes held because they may begin a frame \[bytes\].
    pub fn pending(&self) -> usize {
        self.end - self.start
    }

    /// Discards the bytes held, as after a reopened port; counters stay.
    pub fn reset(&mut self) {
        self.skip(self.pending());
    }

    /// Returns the next event in the bytes held.
    fn take(&mut self) -> Option<G::Event> {
        while self.pending() >= self.wanted {
            let Some(offset) = self.held().iter().position(|byte| *byte == G::START) else {
                self.skip(self.pending());
                return None;
            };
            self.skip(offset);
            match G::inspect(self.held()) {
                Verdict::Wait(bytes) if (self.pending() + 1..=MAX_FRAME).contains(&bytes) => {
                    self.wanted = bytes;
                }
                Verdict::Accept(length, event) => {
                    self.drop_front(length.clamp(1, self.pending()));
                    self.counters.frames += 1;
                    if event.is_some() {
                        return event;
                    }
                }
                // A wait for present bytes, or for more than fit, would never end.
                Verdict::Wait(_) | Verdict::Noise => self.skip(1),
                Verdict::Damaged => {
                    self.counters.damaged += 1;
                    self.skip(1);
                }
            }
        }
        None
    }

    fn append(&mut self, byte: u8) {
        if self.end == CAPACITY {
            self.window.copy_within(self.start.., 0);
            self.end -= self.start;
            self.start = 0;
        }
        self.window[self.end] = byte;
        self.end += 1;
    }

    fn held(&self) -> &[u8] {
        &self.window[self.start..self.end]
    }

    fn skip(&mut self, bytes: usize) {
        self.drop_front(bytes);
        self.counters.skipped += bytes as u64;
    }

    fn drop_front(&mut self, bytes: usize) {
        self.start += bytes;
        self.wanted = 1;
    }
}

/// Events that received bytes complete.
#[must_use = "bytes are only taken as the iterator advances"]
#[derive(Debug)]
pub struct DecodedEvents<'a, G> {
    decoder: &'a mut Decoder<G>,
    bytes: &'a [u8],
}

impl<G: Grammar> Iterator for DecodedEvents<'_, G> {
    type Item = G::Event;

    fn next(&mut self) -> Option<G::Event> {
        loop {
            if let Some(event) = self.decoder.take() {
                return Some(event);
            }
            let (byte, rest) = self.bytes.split_first()?;
            self.bytes = rest;
            self.decoder.append(*byte);
        }
    }
}
