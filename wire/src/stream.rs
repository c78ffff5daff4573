//! Frames out of a stream of bytes that may hold anything: noise, halves of frames, several frames in one read.
//!
//! A [`Grammar`] knows where a frame may begin and looks at what may be one; the [`Decoder`] keeps the bytes. When a frame
//! turns out to be none, the search goes on at the next start byte *within* it, so that a good frame behind a damaged
//! header is not lost.
//!
//! Work is bounded: a candidate is looked at when it has as many bytes as the grammar asked for, and no place begins more than
//! one candidate. Nothing allocates, and no bytes can make it panic.

use std::marker::PhantomData;

/// The longest frame that any grammar may ask for \[bytes\].
pub const MAX_FRAME: usize = 256;

/// Twice the longest frame: bytes move to the front once per frame at most.
const CAPACITY: usize = 2 * MAX_FRAME;

/// What a grammar thinks of the bytes from a start byte on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict<E> {
    /// Could be a frame: look again when there are this many bytes. More than there are, at most [`MAX_FRAME`].
    Wait(usize),
    /// A frame of this many bytes, at least one; without an event if it is of no interest.
    Accept(usize, Option<E>),
    /// Never was a frame.
    Noise,
    /// Was meant as a frame, but length, checksum or end are wrong.
    Damaged,
}

/// A format: where its frames begin, and what they are.
pub trait Grammar {
    /// What a frame says.
    type Event;

    /// The byte that every frame begins with.
    const START: u8;

    /// Judges `bytes`, which begin with [`Grammar::START`].
    fn inspect(bytes: &[u8]) -> Verdict<Self::Event>;
}

/// What a decoder has seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderCounters {
    /// Good frames, those without an event included.
    pub frames: u64,
    /// Frames that were damaged.
    pub damaged: u64,
    /// Bytes that belonged to no good frame.
    pub skipped: u64,
}

/// Finds the frames of one format in a stream.
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
    /// A decoder that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes `bytes` as they came and yields what they complete. Bytes are taken as the iterator advances: run it to its end.
    pub fn push<'a>(&'a mut self, bytes: &'a [u8]) -> DecodedEvents<'a, G> {
        DecodedEvents { decoder: self, bytes }
    }

    /// Frames and bytes so far.
    #[must_use]
    pub fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Bytes held back because they may be the beginning of a frame.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.end - self.start
    }

    /// Forgets the beginning of a frame, as after a reopened port; counts stay.
    pub fn reset(&mut self) {
        self.skip(self.pending());
    }

    /// The next event in the bytes held.
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
                // A grammar that waits for what it has, or for more than fits, waits in vain.
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

/// The events in some bytes.
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
